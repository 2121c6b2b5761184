"""KPIs of loops: steps of the references, then loads on the inputs."""

from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.task import Task
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.tracking import entered
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.scenario import KPI

from .design import Design, Single

_BAND = 0.05
"""Band of settling and recovery, as a share of the step."""
_ROBUST = 2.0
"""Largest sensitivity peak that is usual: a gain margin of 2 and a phase margin of 29 degrees."""


class Laws(Protocol):
    """The controllers of all θ, physical, shape (n,), and their linearized loops."""

    def make(self, theta: Float[np.ndarray, " n"]) -> Controller:
        """Return the controller of a θ."""

    def sensitivity(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the sensitivity peak of the loop of a θ."""

    def around(self, plant: Plant, found: Design) -> Self:
        """Return the same controllers around another plant, which is linearized in `found`."""


@dataclass(frozen=True, slots=True, eq=False)
class Measure:
    """Function of an experiment that returns its KPIs.

    Args:
        design: What was chosen for the plant.
        laws: Controllers of all θ.
    """

    design: Design
    laws: Laws

    def around(self, plant: Plant, task: Task) -> "Measure":
        """Return the same KPIs of another plant, which starts as `task` says."""
        found = self.design.around(plant, task.x0, task.u0, task.disturbance(0.0))
        return replace(self, design=found, laws=self.laws.around(plant, found))

    def __call__(self, experiment: Experiment) -> dict[str, float]:
        """Return the KPIs by name; an infinite time means never."""
        found: dict[str, float] = {}
        for k, loop in enumerate(self.design.loops):
            if len(experiment.t) > 1:
                end = self.design.suffix(k)
                found |= {f"{n}{end}": v for n, v in self._values(experiment, loop, k).items()}
        return found | {"M_s": self.laws.sensitivity(experiment.theta)}

    def _values(self, e: Experiment, loop: Single, k: int) -> dict[str, float]:
        """Return the values of loop k, whose step is after k phases; then the loads come."""
        y, t, phase = e.output(loop.output), e.t, self.design.phase
        assert y is not None
        loads = len(self.design.loops) * phase
        own, late = (t >= k * phase) & (t < (k + 1) * phase), t >= loads
        error = (y - loop.target) / loop.step
        arrived = bool(np.all(np.abs(error[~late][-1:]) <= _BAND))  # or a load may seem to help
        peak = abs(loop.step) * float(np.abs(error[late]).max()) if late.any() else np.inf
        rest = self.design.point.u[loop.input]  # the first move starts there
        moves = np.diff(e.u_control[:, loop.input], prepend=rest)
        return {
            "settling_time": _until(t, error, own, k * phase, (k + 1) * phase),
            "overshoot": 100 * max(float(error[own].max(initial=0.0)), 0.0),
            "disturbance_peak": peak,
            "recovery": _until(t, error, late, loads, loads + phase) if arrived else np.inf,
            "total_move": float(np.abs(moves).sum()),
        }


def _until(
    t: Float[np.ndarray, " K"], error: Float[np.ndarray, " K"], part: np.ndarray, start: float, end: float
) -> float:
    """Return the time from `start` on until the error stays in the band; infinite for never."""
    if not part.any() or t[-1] < end * (1 - 1e-6) - 1e-9:
        return np.inf
    return entered(t[part], error[part], _BAND) - start


_ROWS = (
    (
        "settling_time",
        "settling time of {y} (within ±5 %)",
        "{time}",
        "Time after which it stays close to its reference.",
    ),
    ("overshoot", "overshoot of {y}", "%", "How far it goes beyond its reference, as a share of the step."),
    (
        "disturbance_peak",
        "peak error of {y} under the load",
        "{unit}",
        "Largest distance from the reference after the load sets in.",
    ),
    (
        "recovery",
        "recovery time of {y} (within ±5 %)",
        "{time}",
        "Time from the load until it stays close to its reference again; never, if it was not close when "
        "the load came.",
    ),
    ("total_move", "total move of {u}", "{u_unit}", "Sum of all changes of the input: wear of the actuator."),
)
"""Name, title, unit and meaning of the KPIs of each loop."""


def kpis_of(design: Design, outputs: tuple[Channel, ...], time: str, robust: float) -> tuple[KPI, ...]:
    """Return the KPIs, in order of importance; all are better if lower.

    Args:
        design: What was chosen for the plant.
        outputs: Outputs of the plant.
        time: Unit of time.
        robust: Sensitivity peak in the middle of the ranges. It has an objective if it is met here.
    """
    found: list[KPI] = []
    for k, loop in enumerate(design.loops):
        y, u = outputs[loop.output], loop.channel
        words = {"y": y.name, "unit": y.unit, "time": time, "u": u.name, "u_unit": u.unit}
        for name, title, unit, about in _ROWS:
            more = {"resolution": 0.1} if name == "overshoot" else {}
            end = design.suffix(k)
            found.append(_lower(f"{name}{end}", title.format(**words), unit.format(**words), about, **more))
    about = (
        "Largest amplification of disturbances at any frequency, by the linearized loop: 1.2 to 2 "
        "is usual, a large one is close to instability."
    )
    limit = _ROBUST if robust <= _ROBUST else np.inf
    peak = _lower("M_s", "sensitivity peak M_s", "", about, at_most=limit, resolution=0.01)
    return (*found, peak)


def _lower(name: str, title: str, unit: str, about: str, **more: Any) -> KPI:
    return KPI(name, title, unit, better="lower", about=about, **more)
