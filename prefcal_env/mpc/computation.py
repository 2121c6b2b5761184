"""A model of the computation time t_comp of an MPC step on a given processor, without a clock.

Use it to compare experiments by their computation time with repeatable results.
`Experiment.solve_time` is measured and varies from run to run; this time is computed from the
solver's iterations and the size of its problem.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant

from .limits import Limits
from .settings import MPCSettings

_PRODUCTS = 20
"""Matrix products in one exact discretization (`kernels.hold`): the series and some squarings."""


@dataclass(frozen=True, slots=True)
class StepSize:
    """The size of the problem of one MPC step.

    Args:
        n_x: Number of states.
        n_u: Number of inputs.
        n_y: Number of outputs.
        N_p: Prediction horizon, steps.
        models: Number of discretized models in the horizon: 1, or N_p along a trajectory.
        variables: Number of variables of the QP, including its slack.
        rows: Number of rows of the QP, each with a lower bound, an upper bound or both.
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
        """Return the size of the problems of `LinearMPC(plant, settings)`."""
        limits, s = Limits.of(plant, settings), settings
        n_u = len(plant.inputs)
        limited = np.isfinite(limits.y_min).sum() + np.isfinite(limits.y_max).sum()
        soft = 1 if limits.soft else 0
        return cls(
            n_x=len(plant.states), n_u=n_u, n_y=len(plant.outputs), N_p=s.N_p,
            models=1 if s.linearization == "point" else s.N_p,
            variables=s.N_u * n_u + soft,
            rows=(2 * s.N_u - 1) * n_u + int(limited) * s.N_p + soft,
            soft=bool(soft),
        )  # fmt: skip

    @property
    def building(self) -> float:
        """Number of operations to build the QP and to check its solution.

        This counts the discretization, the backward recursion of every stage, the prediction of
        states and limited outputs as functions of the variables, and three products with the rows
        in the check.
        """
        n_s, n, m = self.n_x + self.n_u, self.variables, self.rows
        discretizing = self.models * _PRODUCTS * 2 * (n_s + 1) ** 3
        stage = 2 * (n_s + self.n_y + 2 * self.n_u) * (n_s + self.n_u) * (n_s + self.n_u + 1)
        predicted = 2 * self.n_x * n_s * (n + 1)
        limited = 2 * self.n_y * n_s * (n + 1) if self.soft else 0
        checking = 6 * m * n + 4 * n**2
        return float(discretizing + self.N_p * (stage + predicted + limited) + checking)

    @property
    def iterating(self) -> float:
        """Number of operations in one iteration of an interior-point solver on the dense QP.

        This counts forming and factorizing its normal matrix, and two solves with their products.
        """
        n, m = self.variables, self.rows
        return float(m * n**2 + n**3 / 3 + 8 * m * n + 4 * n**2)


@dataclass(frozen=True, slots=True)
class Processor:
    """A model of a computer: the cost of a step and of an iteration, and its rates.

    t_comp = step + building operations / building
             + iterations × (iteration + operations of one / solving).

    Args:
        name: Name of the processor.
        step: Fixed cost of every step, whatever its size [s].
        iteration: Fixed cost of every solver iteration, whatever its size [s].
        building: Operations per second while the QP is built and its solution checked.
        solving: Operations per second in the solver.

    Raises:
        SettingsError: If a cost is below 0, or a rate is not positive and finite.
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
                    f"processor {self.name!r}: {name} must be positive and finite operations per "
                    f"second, got {getattr(self, name)}"
                )

    def slower(self, factor: float, name: str) -> "Processor":
        """Return a processor that takes `factor` times as long for everything.

        Raises:
            SettingsError: If the factor is not positive and finite.
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
        """Return the computation time of steps of this size [s], shape (N,).

        Args:
            size: Size of the problem of each step.
            iterations: Number of solver iterations of each step, shape (N,). A second attempt
                (see `LinearMPC.move`) counts with its iterations only.
        """
        once = self.step + size.building / self.building
        return np.asarray(once + iterations * (self.iteration + size.iterating / self.solving))
