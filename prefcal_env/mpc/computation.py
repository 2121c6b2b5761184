"""How long a step of the MPC takes on a stated processor: a model of t_comp, no clock.

Whoever compares experiments by their computation time needs a time that is the same today and
tomorrow. `Experiment.solve_time` is measured, and is not; this is computed from what the solver
did (iterations) and from the size of its problem.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant

from .limits import Limits
from .settings import MPCSettings

_PRODUCTS = 20
"""Products of matrices in one exact discretisation (`_hold`): the series and some squarings."""


@dataclass(frozen=True, slots=True)
class StepSize:
    """How large the problem of one MPC step is.

    Args:
        n_x: States.
        n_u: Inputs.
        n_y: Outputs.
        N_p: Prediction horizon, steps.
        models: Discretised models in the horizon: 1, or N_p along a trajectory.
        variables: Of the QP, its slack included.
        rows: Of the QP, each with a lower or an upper bound or both.
        soft: Whether outputs are limited.
    """

    n_x: int
    n_u: int
    n_y: int
    N_p: int
    models: int
    variables: int
    rows: int
    soft: bool

    @classmethod
    def of(cls, plant: Plant, settings: MPCSettings) -> "StepSize":
        """The size of the problems of `LinearMPC(plant, settings)`."""
        limits, s = Limits.of(plant, settings), settings
        n_u = len(plant.inputs)
        limited = np.isfinite(limits.y_min).sum() + np.isfinite(limits.y_max).sum()
        soft = 1 if limits.soft else 0
        return cls(
            n_x=len(plant.states), n_u=n_u, n_y=len(plant.outputs), N_p=s.N_p,
            models=1 if s.linearisation == "point" else s.N_p,
            variables=s.N_u * n_u + soft,
            rows=(2 * s.N_u - 1) * n_u + int(limited) * s.N_p + soft,
            soft=bool(soft),
        )  # fmt: skip

    @property
    def building(self) -> float:
        """Operations of building the QP and of checking its solution.

        The discretisation, the backward recursion of every stage, the prediction of states and
        limited outputs as functions of the variables, three products with the rows in the check.
        """
        n_s, n, m = self.n_x + self.n_u, self.variables, self.rows
        discretising = self.models * _PRODUCTS * 2 * (n_s + 1) ** 3
        stage = 2 * (n_s + self.n_y + 2 * self.n_u) * (n_s + self.n_u) * (n_s + self.n_u + 1)
        predicted = 2 * self.n_x * n_s * (n + 1)
        limited = 2 * self.n_y * n_s * (n + 1) if self.soft else 0
        checking = 6 * m * n + 4 * n**2
        return float(discretising + self.N_p * (stage + predicted + limited) + checking)

    @property
    def iterating(self) -> float:
        """Operations of one iteration of an interior-point solver on the dense QP.

        Forming and factorising its normal matrix, and two solves with what goes with them.
        """
        n, m = self.variables, self.rows
        return float(m * n**2 + n**3 / 3 + 8 * m * n + 4 * n**2)


@dataclass(frozen=True, slots=True)
class Processor:
    """A computer as this model sees it: what a step and an iteration cost, and how fast it counts.

    t_comp = step + building operations / building
             + iterations × (iteration + operations of one / solving).

    Args:
        name: What it is.
        step: What every step costs, whatever its size [s].
        iteration: What every solver iteration costs, whatever its size [s].
        building: Operations in a second while the QP is built and its solution checked.
        solving: Operations in a second in the solver.

    Raises:
        SettingsError: a cost below 0, or a rate that is not positive and finite.
    """

    name: str
    step: float
    iteration: float
    building: float
    solving: float

    def __post_init__(self) -> None:
        for name in ("step", "iteration"):
            if not 0 <= getattr(self, name) < np.inf:
                raise SettingsError(
                    f"processor {self.name!r}: {name} must be 0 s or more and finite, "
                    f"got {getattr(self, name)}"
                )
        for name in ("building", "solving"):
            if not 0 < getattr(self, name) < np.inf:
                raise SettingsError(
                    f"processor {self.name!r}: {name} must be positive and finite operations in a "
                    f"second, "
                    f"got {getattr(self, name)}"
                )

    def slower(self, factor: float, name: str) -> "Processor":
        """The same, taking `factor` times as long for everything.

        Raises:
            SettingsError: a factor that is not positive and finite.
        """
        if not 0 < factor < np.inf:
            raise SettingsError(f"factor must be positive and finite, got {factor}")
        return Processor(
            name,
            self.step * factor,
            self.iteration * factor,
            self.building / factor,
            self.solving / factor,
        )

    def t_comp(self, size: StepSize, iterations: Int[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """Computation time of steps of this size [s], shape (N,), from their `iterations`.

        A second attempt (`LinearMPC.move`) counts with its iterations alone.
        """
        once = self.step + size.building / self.building
        return np.asarray(once + iterations * (self.iteration + size.iterating / self.solving))


def measured(solve_time: Float[np.ndarray, " N"], *, warm_up: int = 3) -> tuple[float, float]:
    """The worst and the 99th percentile of measured step times [s], once warmed up.

    Not repeatable: for people and benchmarks, never for a comparison.

    Args:
        solve_time: As in an `Experiment`, shape (N,), N of 1 or more.
        warm_up: First steps to leave out, as far as there are more.
    """
    kept = solve_time[min(warm_up, len(solve_time) - 1) :]
    return float(kept.max()), float(np.percentile(kept, 99))
