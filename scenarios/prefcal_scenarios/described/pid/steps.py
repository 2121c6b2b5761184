"""Make the scenario of a plant whose references step one after the other, then loads act."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.stored import as_data
from prefcal_env.envs.experiment_env import ClosedLoop
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.task import Task
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.panels import Panel
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.scenario import Scenario

from .design import Design
from .kpis import Measure, kpis_of
from .loaded import Loaded
from .words import brief_of

_AWAY = 10.0
"""Distance from the start, in steps, at which an output has run away."""
Make = Callable[[Float[np.ndarray, " n"]], Controller]
"""Function of θ that makes the controller."""


def plant_of(plant: Any, horizon: float | None) -> Plant:
    """Return a plant or linear system as a plant, for experiments of a duration.

    Raises:
        PlantError: If it is neither.
        ScenarioError: If the duration is not above 0.
    """
    found: Plant = plant
    if not all(hasattr(plant, name) for name in ("hold", "inputs", "outputs", "states")):
        found = Plant.of(plant)
    if horizon is not None and not 0 < horizon < np.inf:
        raise ScenarioError(f"horizon must be above 0 {found.time_unit}, got {horizon}")
    return found


def scenario_of_steps(
    plant: Plant,
    found: Design,
    make: Make,
    space: KnobSpace,
    sensitivity: Callable[[Float[np.ndarray, " n"]], float],
    **said: Any,
) -> Scenario:
    """Return the scenario of a plant and its controllers.

    Args:
        plant: Plant.
        found: What was chosen for it.
        make: Function of θ that makes the controller.
        space: Knobs of θ.
        sensitivity: Function of θ that returns the sensitivity peak.
        said: Name, title, references and brief of the scenario; an empty brief is found, and the
            first reference is the middle of the ranges.
    """
    middle = next(iter(said["references"].values()))
    run = ClosedLoop(
        PlantEnv(_loaded(plant, found), task_of(plant, found)), make, Measure(found, sensitivity)
    )
    return Scenario(
        space=space,
        run=run,
        kpis=kpis_of(found, plant.outputs, plant.time_unit, sensitivity(middle)),
        panels=_panels(plant, found),
        controller=make,
        settings=Settings(make),
        simulated=True,
        **(said | {"brief": said["brief"] or brief_of(plant, found)}),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Settings:
    """Function of θ that returns the controller as data, from which it can be made again."""

    make: Make

    def __call__(self, theta: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """Return the controller's data for a physical θ, shape (n,)."""
        return as_data(self.make(theta))


def task_of(plant: Plant, found: Design) -> Task:
    """Return the task: one step for each loop, then the loads."""
    point, phase, n = found.point, found.phase, len(found.loops)
    start = np.full(len(plant.outputs), np.nan)
    alone, y_ref, loads = n == 1, start.copy(), np.zeros(len(plant.inputs))
    for loop in found.loops:
        y_ref[loop.output], loads[loop.input] = loop.target, loop.load
    none, acting = (np.concatenate([point.d, part]) for part in (0 * loads, loads))
    schedule = Schedule(found, start, none, acting)
    return Task(
        x0=point.x, u0=point.u, y_ref=y_ref if alone else schedule.reference,
        d=schedule.disturbance, horizon=(n + 1) * phase, T_s=found.T_s, dense_step=found.T_s,
        unsafe=RunsAway(plant, found),
        tracked=tuple(loop.output for loop in found.loops),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """References and disturbances over time."""

    design: Design
    nothing: Float[np.ndarray, " n_y"]
    unloaded: Float[np.ndarray, " n_d"]
    loaded: Float[np.ndarray, " n_d"]

    def reference(self, t: float) -> Float[np.ndarray, " n_y"]:
        """Return the references at time `t`: loop k steps after k phases."""
        y_ref = self.nothing.copy()
        for k, loop in enumerate(self.design.loops):
            stepped = t >= (k - 1e-9) * self.design.phase
            y_ref[loop.output] = loop.target if stepped else loop.start
        return y_ref

    def disturbance(self, t: float) -> Float[np.ndarray, " n_d"]:
        """Return the measured disturbances, which rest, and the loads at time `t`."""
        acting = t >= (len(self.design.loops) - 1e-9) * self.design.phase
        return self.loaded if acting else self.unloaded


class RunsAway:
    """Function of a state that tells whether an output has run away or a state left its limits.

    Args:
        plant: Plant.
        design: What was chosen for it. States that start at or beyond a limit have none.
    """

    def __init__(self, plant: Plant, design: Design) -> None:
        self._plant, self._point, x = plant, design.point, design.point.x
        low, high = (np.array([getattr(c, end) for c in plant.states]) for end in ("low", "high"))
        inside = (low < x) & (x < high)
        self._limits = [
            (k, float(low[k]), float(high[k]))
            for k in np.flatnonzero(inside & (np.isfinite(low) | np.isfinite(high))).tolist()
        ]
        self._outputs = [
            (loop.output, loop.start, _AWAY * abs(loop.target - loop.start))
            for loop in design.loops
        ]

    def __call__(self, x: Float[np.ndarray, " n_x"]) -> bool:
        """Return whether the experiment ends."""
        # A few numbers at every instant: faster than array operations.
        if not all(low <= x[k] <= high for k, low, high in self._limits):
            return True
        y = self._plant.g(x, self._point.u, self._point.d).tolist()
        return any(abs(y[k] - start) > reach for k, start, reach in self._outputs)


def _loaded(plant: Plant, found: Design) -> Loaded:
    """Return the plant with loads, and with limits for every input."""
    inputs = list(plant.inputs)
    for loop in found.loops:
        inputs[loop.input] = loop.channel
    return Loaded(plant, tuple(inputs))


def _panels(plant: Plant, found: Design) -> tuple[Panel, ...]:
    """Return a panel for each output and input; limits far from the step would dwarf it."""
    panels = []
    for loop in found.loops:
        c, room = plant.outputs[loop.output], 2 * abs(loop.target - loop.start)
        low = c.low if abs(c.low - loop.target) <= room else -np.inf
        high = c.high if abs(c.high - loop.target) <= room else np.inf
        panels.append(Panel(c.name, kind="y", low=low, high=high, target=loop.target))
    return (*panels, *(Panel(loop.channel.name, kind="u") for loop in found.loops))
