"""KPIs of loops: steps of the references, then loads on the inputs."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.pid_law import LinearPIDs, Tuning
from prefcal_env.controllers.sampled import Sampled
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_scenarios.scenario import KPI

from .design import Design, Single

_BAND = 0.05
"""Band of settling and recovery, as a share of the step."""
_ROBUST = 2.0
"""Largest sensitivity peak that is usual: a gain margin of 2 and a phase margin of 29 degrees."""


def names_of(design: Design, loop: int) -> str:
    """Return the suffix of the names of knobs and KPIs of a loop: none if there is only one."""
    return "" if len(design.loops) == 1 else f"_{loop + 1}"


@dataclass(frozen=True, slots=True, eq=False)
class Measure:
    """Function of an experiment that returns its KPIs.

    Args:
        design: What was chosen for the plant.
        sensitivity: Function of θ that returns the sensitivity peak of the linearized loop.
    """

    design: Design
    sensitivity: Callable[[Float[np.ndarray, " n"]], float]

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


@dataclass(frozen=True, slots=True, eq=False)
class PIDSensitivity:
    """Function of θ that returns the largest singular value of (1 + G C)^-1 of its PIDs.

    Args:
        design: What was chosen for the plant.
        plant: Sampled linear plant, from the inputs to the outputs of the loops.
        N: Filter of the derivative parts.
    """

    design: Design
    plant: Sampled
    N: float

    def __call__(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the sensitivity peak; infinite if the loop is unstable."""
        omega = np.geomspace(1e-4, 0.999, 300) * np.pi / self.plant.T_s
        pids = LinearPIDs.of(tunings_of(self.design, theta), self.N)
        return float(pids.sensitivity(self.plant, omega)[0])


def tunings_of(design: Design, theta: Float[np.ndarray, " n"]) -> list[Tuning]:
    """Return the tuning of each loop for θ: K_p, T_i, T_d and b of each loop in turn."""
    signs = [float(np.sign(tuned.center.K_p)) for tuned in design.tunings]
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
    arrived = bool(np.all(np.abs(error[~late][-1:]) <= _BAND))  # or a load may seem to help
    return [
        ("settling_time", _until(t, error, own, k * phase, (k + 1) * phase)),
        ("overshoot", 100 * max(float(error[own].max(initial=0.0)), 0.0)),
        ("disturbance_peak", size * float(np.abs(error[late]).max()) if late.any() else np.inf),
        ("recovery", _until(t, error, late, n * phase, (n + 1) * phase) if arrived else np.inf),
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


def kpis_of(
    design: Design, outputs: tuple[Channel, ...], time_unit: str, robust: float
) -> tuple[KPI, ...]:
    """Return the KPIs, in order of importance; all are better if lower.

    Args:
        design: What was chosen for the plant.
        outputs: Outputs of the plant.
        time_unit: Unit of time.
        robust: Sensitivity peak in the middle of the ranges. It has an objective if it is met here.
    """
    found: list[KPI] = []
    for k, loop in enumerate(design.loops):
        found += _of_loop(names_of(design, k), outputs[loop.output], loop.channel, time_unit)
    about = (
        "Largest amplification of disturbances at any frequency, by the linearized loop: 1.2 to 2 "
        "is usual, a large one is close to instability."
    )
    limit = _ROBUST if robust <= _ROBUST else np.inf
    found.append(KPI("M_s", "sensitivity peak M_s", "", better="lower", about=about, at_most=limit,
                     resolution=0.01))  # fmt: skip
    return tuple(found)


def _of_loop(end: str, y: Channel, u: Channel, time: str) -> list[KPI]:
    return [
        KPI(f"settling_time{end}", f"settling time of {y.name} (within ±5 %)", time,
            better="lower", about="Time after which it stays close to its reference."),
        KPI(f"overshoot{end}", f"overshoot of {y.name}", "%", better="lower", resolution=0.1,
            about="How far it goes beyond its reference, as a share of the step."),
        KPI(f"disturbance_peak{end}", f"peak error of {y.name} under the load", y.unit,
            better="lower", about="Largest distance from the reference after the load sets in."),
        KPI(f"recovery{end}", f"recovery time of {y.name} (within ±5 %)", time, better="lower",
            about="Time from the load until it stays close to its reference again; never, if it "
            "was not close when the load came."),
        KPI(f"total_move{end}", f"total move of {u.name}", u.unit, better="lower",
            about="Sum of all changes of the input: wear of the actuator."),
    ]  # fmt: skip
