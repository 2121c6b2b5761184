"""KPIs of PID loops: steps of the references, then loads on the inputs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.pid_law import LinearPIDs, Tuning
from prefcal_env.controllers.sampled import Sampled
from prefcal_env.experiments.experiment import Experiment

from .design import Design, Single

_BAND = 0.05
"""Band of settling and recovery, as a share of the step."""


def names_of(design: Design, loop: int) -> str:
    """Return the suffix of the names of knobs and KPIs of a loop: none if there is only one."""
    return "" if len(design.loops) == 1 else f"_{loop + 1}"


@dataclass(frozen=True, slots=True, eq=False)
class Measure:
    """Function of an experiment that returns its KPIs.

    Args:
        design: What was chosen for the plant.
        plant: Sampled linear plant, from the inputs to the outputs of the loops.
        N: Filter of the derivative parts.
    """

    design: Design
    plant: Sampled
    N: float

    def __call__(self, experiment: Experiment) -> dict[str, float]:
        """Return the KPIs by name; an infinite time means never."""
        loops, phase = self.design.loops, self.design.phase
        found: dict[str, float] = {}
        for k, loop in enumerate(loops):
            if len(experiment.t) > 1:
                end = names_of(self.design, k)
                found |= {
                    f"{n}{end}": v for n, v in _values(experiment, loop, k, len(loops), phase)
                }
                rest = self.design.point.u[loop.input]  # the first move starts there
                moves = np.diff(experiment.u_control[:, loop.input], prepend=rest)
                found[f"total_move{end}"] = float(np.abs(moves).sum())
        return found | {"M_s": self.sensitivity(experiment.theta)}

    def sensitivity(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the largest singular value of (1 + G C)^-1; infinite if it is unstable."""
        omega = np.geomspace(1e-4, 0.999, 300) * np.pi / self.plant.T_s
        pids = LinearPIDs.of(tunings_of(self.design, theta), self.N)
        return float(pids.sensitivity(self.plant, omega)[0])


def tunings_of(design: Design, theta: Float[np.ndarray, " n"]) -> list[Tuning]:
    """Return the tuning of each loop for θ: K_p, T_i, T_d and b of each loop in turn."""
    signs = [float(np.sign(loop.center.K_p)) for loop in design.loops]
    rows = np.reshape(theta[: 4 * len(signs)], (-1, 4)).tolist()
    return [Tuning(s * row[0], row[1], row[2]) for s, row in zip(signs, rows, strict=True)]


def _values(e: Experiment, loop: Single, k: int, n: int, phase: float) -> list[tuple[str, float]]:
    """Return the values of a loop's KPIs; its step is at k phases, the loads are at n."""
    y = e.output(loop.output)
    assert y is not None
    step, t = loop.target - loop.start, e.t
    own = (t >= k * phase) & (t < (k + 1) * phase)
    late = t >= n * phase
    error = (y - loop.target) / step
    size = abs(step)
    return [
        ("settling_time", _until(t, error, own, k * phase, (k + 1) * phase)),
        ("overshoot", 100 * max(float(error[own].max(initial=0.0)), 0.0)),
        ("disturbance_peak", size * float(np.abs(error[late]).max()) if late.any() else np.inf),
        ("recovery", _until(t, error, late, n * phase, (n + 1) * phase)),
    ]


def _until(
    t: Float[np.ndarray, " K"], error: Float[np.ndarray, " K"], part: np.ndarray, start: float,
    end: float,
) -> float:  # fmt: skip
    """Return the time from `start` on until the error stays in the band; infinite for never."""
    if not part.any() or t[-1] < end * (1 - 1e-6) - 1e-9:
        return np.inf
    instants, outside = t[part], np.flatnonzero(np.abs(error[part]) > _BAND)
    last = int(outside[-1]) if len(outside) else -1
    return float(instants[last + 1] - start) if last + 1 < len(instants) else np.inf
