"""What varies in the closed loops that come with prefcal."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.task import Task
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller, Measurement, Move
from prefcal_env.jit import kernel
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plants.jacobians import U, Y
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.cases.loops._laws import MEMORY, decide
from prefcal_scenarios.cases.loops.controllers import Gains, Tunable, TunedLQR, TunedPID, Values
from prefcal_scenarios.cases.loops.loop import Actuator, Loop
from prefcal_scenarios.cases.loops.plant import CompiledPlant

from .loops import DIRECTION, REFERENCE, SHIFT, VariedLoop
from .rest import rest
from .subject import Subject

_ROOM = 2.0
"""Distance of a limit from start and targets, in steps, that leaves room for other references."""


def of_loop(loop: Loop, space: KnobSpace) -> Subject:
    """Return what varies of a loop whose θ are in `space`; a model in its controller stays."""
    law, moves = isinstance(loop.controller, TunedPID | TunedLQR), tuple(_moves(loop))
    build, make = partial(_built, loop, space), partial(controller_of, loop)
    varied = VariedLoop(loop.plant, loop.task, build, make, wears=law, moves=moves)
    ideal = "sensors and actuators of an MPC are ideal here: only noise and ranges are varied"
    near = "start, size and direction of the step are not varied: a limit is near the target"
    return varied.subject(*([] if law else [ideal]), *([] if moves else [near]))


def _built(loop: Loop, space: KnobSpace, plant: Plant, task: Task, grain: Y, play: U) -> Any:
    """Return the run of a loop with another plant and task, whose sensors and actuators are worn."""
    assert isinstance(plant, CompiledPlant)
    actuators = loop.actuators or (Actuator(),) * len(play)
    worn = (replace(a, backlash=a.backlash + p) for a, p in zip(actuators, play.tolist(), strict=True))
    made = replace(
        loop,
        plant=plant,
        task=task,
        controller=Designed(loop.controller, loop.plant, loop.task),
        actuators=tuple(worn) if play.any() else loop.actuators,
        resolution=tuple(np.maximum(grain, loop.resolution or 0.0)) if grain.any() else loop.resolution,
    )
    return partial(made.run, space=space)


def _moves(loop: Loop) -> Iterator[str]:
    """Yield what can vary of the step: all if no limit of the output is near, and the other side exists."""
    plant, task, y0 = loop.plant, loop.task, loop.task.x0[list(loop.plant.measured)]
    aims = np.array([y0, loop.target.start, *(v for _, v in loop.target.steps)])
    c, step = plant.states[plant.measured[0]], abs(aims[1, 0] - y0[0])
    if min(aims[:, 0].min() - c.low, c.high - aims[:, 0].max()) < _ROOM * step:
        return
    yield from (REFERENCE, SHIFT)
    n = min(len(plant.inputs), len(y0))
    mirrored = (2 * y0 - aims[1])[:n].tolist()
    found = rest(plant, task.x0, task.u0, task.disturbance(0.0), range(n), mirrored)
    if found is not None:
        pairs = zip((*plant.states, *plant.inputs), np.concatenate(found), strict=True)
        if all(c.low <= value <= c.high for c, value in pairs):
            yield DIRECTION


@dataclass(frozen=True, slots=True)
class Designed:
    """A kind of controller that is designed for the plant of the study, whatever plant it meets."""

    controller: Tunable
    plant: CompiledPlant
    task: Task

    def make(self, values: Values, plant: CompiledPlant, task: Task, T_s: float) -> Gains | Controller:
        """Return the controller of the study, which starts at the inputs and limits that it meets."""
        controller, found = self.controller, replace(self.plant, inputs=plant.inputs)
        if isinstance(controller, TunedPID) and controller.inner is not None:
            start = float(task.x0[plant.measured[1]]) - float(self.task.x0[plant.measured[1]])
            middle, low, high = controller.inner
            controller = replace(controller, inner=(middle + start, low, high))
        if isinstance(controller, TunedPID | TunedLQR):
            return controller.make(values, found, replace(self.task, u0=task.u0), T_s)
        return controller.make(values, self.plant, self.task, T_s)


def controller_of(loop: Loop, theta: Float[np.ndarray, " n"]) -> Controller:
    """Return the controller of a physical θ, shape (n,).

    Raises:
        SettingsError: If its input has stages, which no linear law has.
    """
    if loop.staged:
        raise SettingsError("an input in stages has no linear law")
    plant, values = loop.plant, dict(zip(loop.space.names, theta.tolist(), strict=True))
    T_s = values.get("T_s", loop.task.T_s) * values.get("every", 1.0)
    T_s = max(round(T_s / plant.max_step), 1) * plant.max_step
    made = loop.controller.make(values, plant, loop.task, T_s)
    return LawController(made, T_s) if isinstance(made, Gains) else made


@kernel()
def _act(law, gains, reference, y, memory, T_s, u):  # type: ignore[no-untyped-def]
    """Write the inputs that a compiled law decides to `u`."""
    decide(law, gains, reference, y, memory, T_s, u)


class LawController:
    """A compiled law as a `Controller`.

    Args:
        gains: Law and its gains.
        T_s: Sampling time, in the plant's unit of time.
    """

    def __init__(self, gains: Gains, T_s: float) -> None:
        self._gains, self.T_s = gains, T_s
        self._memory = np.zeros((len(gains.rows), MEMORY))

    def move(self, measurement: Measurement) -> Move:
        """Decide the inputs from the measured outputs."""
        u, y = np.array(measurement.u, dtype=float), np.array(measurement.y, dtype=float)
        r = np.array(measurement.y_ref, dtype=float)
        _act(self._gains.law, np.array(self._gains.rows), r, y, self._memory, float(self.T_s), u)
        return Move(u)
