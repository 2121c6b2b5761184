"""What varies in the closed loops that come with prefcal."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from prefcal_env.envs.step_signal import StepSignal
from prefcal_env.envs.task import Task
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.cases.loops.controllers import Gains, Tunable, TunedLQR, TunedPID
from prefcal_scenarios.cases.loops.controllers import Values as Knobs
from prefcal_scenarios.cases.loops.loop import Actuator, Loop
from prefcal_scenarios.cases.loops.plant import CompiledPlant
from prefcal_scenarios.cases.loops.right_hand_sides import Linear, Parameters

from .factor import Factor, Kind, Values
from .plants import DELAY, GRAIN, LOAD, NOISE, PLAY, narrowed
from .rest import rest

_SIZE, _WEAR, _RANGE = 0.2, (-0.5, 1.0), 0.1
"""Relative changes: of dead time, reference and load; of noise and roughness; of an input's range."""
_PLAY = 0.005
"""Largest half backlash of an actuator without any, as a share of its range."""
_ROOM = 2.0
"""Distance of a limit from the target, in steps, that leaves room for other references."""
_OFFSET = 0.1
"""Largest change of the operating point, in steps."""
DIRECTION, REFERENCE, START, WEAR = "direction of the step", "size of the step", "start", "roughness"


class LoopSubject:
    """A `Loop` whose plant, sensors, actuators and task vary, while its controller stays.

    A model in the controller stays that of the study. Each varied plant starts at rest, at the
    output at which the study starts: its controller had brought it there.
    """

    def __init__(self, loop: Loop, space: KnobSpace) -> None:
        self.loop, self.space = loop, space
        self.law = isinstance(loop.controller, TunedPID | TunedLQR)
        said = ["sampling jitter is not varied: the loop is simulated with constant periods"]
        said += ["no rate of an actuator is known, so none is varied"]
        if not self.law:
            said += ["sensors and actuators of an MPC are ideal here: only noise and ranges are varied"]
        if not loop.plant.dead_time:
            said += ["the plant has no dead time, and none is added: see the delay margin"]
        if not self._roomy:
            said += ["start, size and direction of the step are not varied: a limit is near the target"]
        self.left_out = tuple(said)
        self.factors = (*_parameters(loop.plant), *self._others())

    def at(self, values: Values) -> Callable[..., Experiment]:
        """Return the run of the varied loop."""
        return partial(self.varied(values).run, space=self.space)

    def varied(self, values: Values) -> Loop:
        """Return the loop with these values."""
        loop = self.loop
        plant = _plant(loop.plant, values)
        task = _task(loop, plant, values)
        actuators = loop.actuators or (Actuator(),) * len(plant.inputs)
        wear = values.get(WEAR, 1.0)
        rough = tuple(
            replace(
                each,
                stiction=wear * each.stiction,
                backlash=wear * each.backlash + values.get(PLAY, 0.0) * (c.high - c.low),
            )
            for each, c in zip(actuators, plant.inputs, strict=True)
        )
        alike = all(each == Actuator() for each in rough)
        return replace(
            loop,
            plant=plant,
            task=task,
            controller=Designed(loop.controller, loop.plant, loop.task),
            actuators=() if alike else rough,
            resolution=tuple(values.get(GRAIN, 1.0) * each for each in loop.resolution),
        )

    @property
    def _roomy(self) -> bool:
        """Whether no limit of the output is near start and targets."""
        loop, first = self.loop, self.loop.plant.measured[0]
        start, aims = float(loop.task.x0[first]), [loop.target.start, *(v for _, v in loop.target.steps)]
        step = abs(aims[0][0] - start)
        channel = loop.plant.states[first]
        ends = min(start, *(a[0] for a in aims)), max(start, *(a[0] for a in aims))
        return bool(min(ends[0] - channel.low, channel.high - ends[1]) >= _ROOM * step)

    def _others(self) -> Iterator[Factor]:
        """Yield what varies besides the parameters of the plant."""
        loop, plant = self.loop, self.loop.plant
        if plant.dead_time:
            yield Factor.around(DELAY, "dead time", _SIZE, plant.dead_time, plant.time_unit)
        yield Factor.around(NOISE, "sensor", _WEAR)
        if any(loop.resolution):
            yield Factor.around(GRAIN, "sensor", _WEAR)
        yield from (Factor(f"range of {c.name}", "actuator", 1.0, 1 - _RANGE, 1.0) for c in plant.inputs)
        if any(a.stiction or a.backlash for a in loop.actuators):
            yield Factor.around(WEAR, "actuator", _WEAR)
        elif self.law and not loop.staged:
            yield Factor(PLAY, "actuator", 0.0, 0.0, _PLAY)
        yield Factor.around(LOAD, "task", _SIZE)
        if self._roomy:
            yield Factor.around(REFERENCE, "task", _SIZE)
            yield Factor(START, "task", 0.0, -_OFFSET, _OFFSET)
            if _mirrored(loop):
                yield Factor(DIRECTION, "task", 1.0, -1.0, 1.0, ends=True)


@dataclass(frozen=True, slots=True)
class Designed:
    """A kind of controller that is designed for the plant of the study, whatever plant it meets."""

    controller: Tunable
    plant: CompiledPlant
    task: Task

    def make(self, values: Knobs, plant: CompiledPlant, task: Task, T_s: float) -> Gains | Controller:
        """Return the controller of the study, which starts at the inputs and limits that it meets."""
        controller, found = self.controller, replace(self.plant, inputs=plant.inputs)
        if isinstance(controller, TunedPID) and controller.inner is not None:
            start = float(task.x0[plant.measured[1]]) - float(self.task.x0[plant.measured[1]])
            middle, low, high = controller.inner
            controller = replace(controller, inner=(middle + start, low, high))
        if isinstance(controller, TunedPID | TunedLQR):
            return controller.make(values, found, replace(self.task, u0=task.u0), T_s)
        return controller.make(values, self.plant, self.task, T_s)


def _parameters(plant: CompiledPlant) -> Iterator[Factor]:
    """Yield the parameters of a plant; of matrices, time constants and gains."""
    kind: Kind = "parameter"
    if not isinstance(plant.parameters, Linear):
        for name, value in plant.parameters._asdict().items():
            yield Factor.around(name.replace("_", " "), kind, 0.1, value)
        return
    for state in plant.states[: len(plant.parameters.A)]:
        if not _is_definition(plant.parameters, plant.states.index(state)):
            yield Factor.around(f"time constant of {state.name}", kind, 0.1)
    yield from (Factor.around(f"gain of {c.name}", kind, 0.1) for c in plant.inputs)


def _is_definition(p: Linear, i: int) -> bool:
    """Return whether row i says what a state is, such as ẋ = v, and so has no parameter."""
    return not any((*p.B[i], *p.E[i])) and all(abs(each) in (0.0, 1.0) for each in p.A[i])


def _plant(plant: CompiledPlant, values: Values) -> CompiledPlant:
    """Return the plant with other parameters, dead time and ranges of its inputs."""
    p = plant.parameters
    if isinstance(p, Linear):
        rates = [1 / values.get(f"time constant of {c.name}", 1.0) for c in plant.states]
        gains = [values.get(f"gain of {c.name}", 1.0) for c in plant.inputs]
        A, B, E = (np.array(rows, dtype=float) * np.array(rates)[:, None] for rows in (p.A, p.B, p.E))
        parameters: Parameters = Linear(*(tuple(map(tuple, M.tolist())) for M in (A, B * gains, E)))
    else:
        named = {n: values.get(n.replace("_", " "), v) for n, v in p._asdict().items()}
        parameters = type(p)(**named)
    dead_time = values.get(DELAY, plant.dead_time)
    inputs = tuple(narrowed(c, values.get(f"range of {c.name}", 1.0)) for c in plant.inputs)
    return replace(plant, parameters=parameters, dead_time=dead_time, inputs=inputs)


def _task(loop: Loop, plant: CompiledPlant, values: Values) -> Task:
    """Return the task at the steady state of the varied plant, with other steps and noise."""
    task, target = loop.task, loop.target
    y0 = task.x0[list(plant.measured)]
    step = target.start[0] - y0[0]
    shift = values.get(START, 0.0) * step
    before = np.asarray(loop.disturbance.start, dtype=float)
    n = min(len(plant.inputs), len(plant.measured))
    aims = y0[:n] + np.eye(n)[0] * shift
    x0, u0 = rest(plant, task.x0, task.u0, before, range(n), aims.tolist()) or (task.x0, task.u0)
    moved = x0[list(plant.measured)] - y0
    size = values.get(REFERENCE, 1.0) * values.get(DIRECTION, 1.0)

    def aimed(row: Sequence[float] | np.ndarray) -> tuple[float, ...]:
        return tuple((y0 + size * (np.asarray(row) - y0) + moved).tolist())

    y_ref = StepSignal(aimed(target.start), tuple((t, aimed(row)) for t, row in target.steps))
    load = values.get(LOAD, 1.0)
    (at, after), *_ = loop.disturbance.steps
    d = StepSignal(loop.disturbance.start, ((at, tuple((before + load * (after - before)).tolist())),))
    assert task.noise is not None
    noise = values.get(NOISE, 1.0) * task.noise
    return replace(task, x0=x0, u0=u0, y_ref=y_ref, d=d, noise=noise)


def _mirrored(loop: Loop) -> bool:
    """Return whether the plant can rest at the mirrored target, within its limits."""
    plant, task = loop.plant, loop.task
    y0 = task.x0[list(plant.measured)]
    n = min(len(plant.inputs), len(plant.measured))
    aims = (2 * y0 - np.asarray(loop.target.start))[:n]
    d = np.asarray(loop.disturbance.start, dtype=float)
    found = rest(plant, task.x0, task.u0, d, range(n), aims.tolist())
    if found is None:
        return False
    pairs = [*zip(plant.states, found[0], strict=True), *zip(plant.inputs, found[1], strict=True)]
    return all(c.low <= value <= c.high for c, value in pairs)
