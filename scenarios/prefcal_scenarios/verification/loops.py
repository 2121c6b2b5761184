"""What varies in a closed loop: any plant and controller, those that come with prefcal, other sources."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_number
from prefcal_env.controllers.margins import Margins, margins
from prefcal_env.envs.closed_loop import ClosedLoop, ControllerFactory
from prefcal_env.envs.cstr import cstr_env
from prefcal_env.envs.overtake import OvertakeOptions
from prefcal_env.envs.plant_env import PlantEnv, tracked_of
from prefcal_env.envs.task import Signal, StepSignal, Task
from prefcal_env.errors import PlantError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import Channel, Controller, Experiment, Measurement, Move
from prefcal_env.jit import kernel
from prefcal_env.knobs import KnobSpace
from prefcal_env.optional import world_of
from prefcal_env.plants.jacobians import U, X, Y
from prefcal_env.plants.plant import Plant
from prefcal_env.sources.source import Function, Maneuvers, Source, WithKPIs, function_of
from prefcal_scenarios.cases.cstr import compute_kpis, controller
from prefcal_scenarios.cases.loops.loop import Actuator, Gains, KnobValues, Loop, Tunable, TunedLQR, TunedPID
from prefcal_scenarios.cases.loops.plants import MEMORY, CompiledPlant, decide
from prefcal_scenarios.described.steps import Measure

from .plants import (
    CHANGE,
    DELAY,
    LEAST,
    NOT_NEGATIVE,
    SIZE,
    Factor,
    Subject,
    Values,
    at_rest,
    factors_of,
    latest,
    of_maneuvers,
    rest,
    varied_plant,
    waits_inside,
    within,
)

# --- What varies in a closed loop of any plant and controller.

_WEAR = (-0.5, 1.0)  # relative change of noise
_NOISE, _GRAIN, _PLAY, _OFFSET = 0.002, 0.005, 0.005, 0.1
"""Largest noise of sensors without any, and resolution, as shares of the largest step; half backlash
of actuators, as a share of the range; change of the operating point, as a share of the step."""
NOISE, GRAIN, PLAY, LOAD = "noise", "resolution of sensors", "backlash", "size of the load"
JITTER, _JITTER, _MOST = "sampling jitter", 0.1, 0.49
"""Largest jitter, as a share of the period: the usual and the possible one."""
MOVE, SHIFT, REFERENCE, DIRECTION = "rate of the actuators", "start", "size of the step", "direction"
TURN = "direction of the load"
_ROOM = 2.0  # distance of a limit from start and targets, in steps, that leaves room for other references
_ENDS = (-_OFFSET, 1 + SIZE + _OFFSET)  # what a varied start and reference reach, in steps
Build = Callable[[Plant, Task, Y, U], Callable[..., Experiment]]
"""Function of plant, task, resolution of the sensors, shape (n_y,), and half backlash of the
actuators, shape (n_u,), that returns the run; the controller stays as it is designed."""


def of_closed_loop(loop: ClosedLoop) -> Subject:
    """Return what varies in the loop of a `PlantEnv`. Raises ScenarioError if it has another one."""
    env = loop.env
    if not isinstance(env, PlantEnv):
        raise ScenarioError(
            "only the loop of a PlantEnv can be varied, since it says its plant and task: "
            f"make its environment one, got {type(env).__name__}"
        )
    discrete = getattr(env.plant, "sample_time", 0.0) > 0
    build = partial(_built, loop)
    moves, said = tuple[str, ...](), ["references and start are not varied: the KPIs are those of this step"]
    if isinstance(loop.kpis, Measure):
        targets = [(each.output, each.target) for each in loop.kpis.design.loops]
        moves = tuple(_moves(env.plant, env.task, env.plant.outputs, targets, _ENDS))
        said = [] if moves else ["references and start are not varied: a limit of the plant is near"]
    varied = VariedLoop(env.plant, env.task, build, loop.controller, jitters=not discrete, moves=moves)
    return varied.subject(*said)


def _built(loop: ClosedLoop, plant: Plant, task: Task, grain: Y, play: U) -> ClosedLoop:
    worn = partial(Worn.of, loop.controller, grain, play, plant.inputs)
    make = worn if grain.any() or play.any() else loop.controller
    kpis = loop.kpis.around(plant, task) if isinstance(loop.kpis, Measure) else loop.kpis
    return ClosedLoop(PlantEnv(plant, task), make, kpis)


def _moves(
    plant: Plant,
    task: Task,
    limits: Sequence[Channel],
    targets: Sequence[tuple[int, float]],
    ends: Sequence[float] = (),
) -> Iterator[str]:
    """Yield what can vary of the step: all if no limit of an output is near, and the other side exists.

    Args:
        plant: Plant.
        task: Task.
        limits: Limits of each output.
        targets: Index of an output and its reference after the step, in the order of the loops.
        ends: Shares of the step at which the plant must rest within its limits, too.
    """
    x0, u0, d = task.x0, task.u0, task.disturbance(0.0)
    chosen = list(targets)[: len(plant.inputs)]
    y0, all_limits = plant.g(x0, u0, d), (*plant.states, *plant.inputs)
    for k, target in chosen[:1] if not ends else chosen:
        room = min(min(y0[k], target) - limits[k].low, limits[k].high - max(y0[k], target))
        if room < _ROOM * abs(target - y0[k]):
            return

    def rests(share: float) -> bool:
        aims = [float(y0[k] + share * (target - y0[k])) for k, target in chosen]
        found = rest(plant, x0, u0, d, [k for k, _ in chosen], aims)
        if found is None:
            return False
        return all(c.low <= v <= c.high for c, v in zip(all_limits, np.concatenate(found), strict=True))

    if all(map(rests, ends)):
        yield from (REFERENCE, SHIFT, *([DIRECTION] if rests(-1.0) else []))


@dataclass(frozen=True, slots=True, eq=False)
class VariedLoop:
    """A closed loop whose plant, sensors, actuators and task vary, while its controller stays.

    A varied plant starts at rest with the outputs of the study: its controller had brought it there.
    """

    plant: Plant  # plant of the study
    task: Task  # task of the study
    build: Build  # what a loop does
    controller: ControllerFactory  # function of θ that makes the controller
    wears: bool = True  # whether sensors can have a resolution, and actuators backlash
    jitters: bool = False  # whether periods can differ
    moves: tuple[str, ...] = ()  # what varies of the step: `SHIFT`, `REFERENCE`, `DIRECTION` or less

    def subject(self, *said: str) -> Subject:
        """Return what varies; `said` is what does not, beside what follows from plant and task."""
        late, waits = latest(self.plant, self.task.measurement_delay) > 0, waits_inside(self.plant)
        missing = {
            "the plant states no dead time, and none is added (that of a Padé approximation varies with the "
            "time constants): see the delay margin": late or waits,
            "dead time in the states of the plant (poles at 0) is not varied: state it as a delay": not waits,
            "no rate of an actuator is stated, so none is varied": self.task.max_move is not None,
            "the task has no steps of a load, so none is varied": self._loaded,
            "sampling jitter is not varied: a period has one length": self.jitters,
            "no lag of the actuators that nobody modeled is added: see the delay margin": False,
            "a bias of the sensors is not varied: it moves the output, whatever the tuning": False,
        }
        left_out = (*said, *(text for text, there in missing.items() if not there))
        factors = (*factors_of(self.plant, self.task.measurement_delay), *self._others())
        return Subject(factors, left_out, self.at, self.margins)

    def at(self, values: Values) -> Function:
        """Return the run of the loop with these values."""
        plant = varied_plant(self.plant, values, self._later(values))
        spans = np.array([c.high - c.low for c in plant.inputs])
        play = values.get(PLAY, 0.0) * np.where(np.isfinite(spans), spans, 0.0)
        grain = values.get(GRAIN, 0.0) * self._step
        return Function(self.build(plant, self.task_of(plant, values), grain, play))

    def margins(self, theta: Float[np.ndarray, " n"]) -> Margins | str:
        """Return the margins of a physical θ, shape (n,), or why there are none."""
        try:
            return margins(self.plant, self.task, partial(self.controller, theta))
        except Exception as error:  # people's own plants and controllers can raise anything
            return f"no margins: {error}"

    def _others(self) -> Iterator[Factor]:
        """Yield what varies beside the plant."""
        if self._noisy:
            yield Factor.around(NOISE, "sensor", _WEAR, possible=NOT_NEGATIVE)
        else:
            yield Factor(NOISE, "sensor", 0.0, 0.0, _NOISE, "of the step", possible=NOT_NEGATIVE)
        if self.wears:
            yield Factor(GRAIN, "sensor", 0.0, 0.0, _GRAIN, "of the step", possible=NOT_NEGATIVE)
            yield Factor(PLAY, "actuator", 0.0, 0.0, _PLAY, "of the range", possible=NOT_NEGATIVE)
        if self.jitters:
            yield Factor(JITTER, "sensor", 0.0, 0.0, _JITTER, "of the period", possible=(0.0, _MOST))
        if self.task.max_move is not None:
            yield Factor.around(MOVE, "actuator", SIZE, possible=(LEAST, np.inf))
        if self._loaded:
            yield Factor.around(LOAD, "task", SIZE, possible=NOT_NEGATIVE)
            yield Factor(TURN, "task", 1.0, -1.0, 1.0, ends=True)
        steps = (
            Factor.around(REFERENCE, "task", SIZE, possible=(LEAST, np.inf)),
            Factor(SHIFT, "task", 0.0, -_OFFSET, _OFFSET, "of the step"),
            Factor(DIRECTION, "task", 1.0, -1.0, 1.0, ends=True),
        )
        yield from (factor for factor in steps if factor.name in self.moves)

    def _later(self, values: Values) -> float:
        """Return the factor of all dead times."""
        late = values.get(DELAY)
        return 1.0 if late is None else late / latest(self.plant, self.task.measurement_delay)

    @property
    def _noisy(self) -> bool:
        return self.task.noise is not None and bool(np.any(self.task.noise))

    @property
    def _loaded(self) -> bool:
        return isinstance(self.task.d, StepSignal) and bool(self.task.d.steps)

    @property
    def start(self) -> Y:
        """Outputs at the start, shape (n_y,)."""
        return np.asarray(self.plant.g(self.task.x0, self.task.u0, self.task.disturbance(0.0)))

    @property
    def _step(self) -> Y:
        """Largest change of each output's reference, from the start, shape (n_y,); 0 for none."""
        y_ref = self.task.y_ref
        times = [0.0, *(t for t, _ in y_ref.steps)] if isinstance(y_ref, StepSignal) else [0.0]
        changes = np.array([np.abs(self.task.reference(t) - self.start) for t in times])
        return np.asarray(np.nan_to_num(changes).max(axis=0))

    def task_of(self, plant: Plant, values: Values) -> Task:
        """Return the task of a varied plant, which starts at rest, with other noise, rate, load and step."""
        task, d = self.task, self.task.d
        if self._noisy:
            noise = values.get(NOISE, 1.0) * np.asarray(task.noise)
        else:
            noise = values.get(NOISE, 0.0) * self._step
        load = values.get(LOAD, 1.0) * values.get(TURN, 1.0)
        if load != 1.0 and isinstance(d, StepSignal):
            d = _scaled(d, np.asarray(d.start, dtype=float), load)
        x0, u0 = self._rest(plant, values.get(SHIFT, 0.0))
        y_ref: Signal = task.y_ref
        if self.moves and not callable(y_ref):
            y_ref = StepSignal(y_ref, ())
        if self.moves and isinstance(y_ref, StepSignal):
            size = values.get(REFERENCE, 1.0) * values.get(DIRECTION, 1.0)
            y_ref = _scaled(y_ref, self.start, size, plant.g(x0, u0, task.disturbance(0.0)) - self.start)
        moves = None if task.max_move is None else task.max_move * values.get(MOVE, 1.0)
        if (later := self._later(values)) != 1.0:
            task = replace(task, measurement_delay=(later * np.asarray(task.measurement_delay)).tolist())
        if self._noisy or noise.any():
            task = replace(task, noise=noise)
        jitter = max(task.jitter, values.get(JITTER, 0.0))
        return replace(task, x0=x0, u0=u0, y_ref=y_ref, d=d, max_move=moves, jitter=jitter)

    def _rest(self, plant: Plant, shift: float) -> tuple[X, U]:
        """Return where a plant rests with the outputs of the start, the first moved by `shift` steps.

        If there is no such state, it is the start.
        """
        start, d = (self.task.x0, self.task.u0), self.task.disturbance(0.0)
        chosen = tracked_of(self.task)[: len(plant.inputs)]
        aims = self.start[list(chosen)]
        aims[:1] += shift * (self.task.reference(0.0) - self.start)[list(chosen[:1])]
        try:
            resting = at_rest(self.plant, *start, d)
            return (rest(plant, *start, d, chosen, aims.tolist()) if resting else None) or start
        except PlantError:  # a discrete plant without ẋ
            return start


def _scaled(
    signal: StepSignal, around: np.ndarray, size: float, shift: np.ndarray | float = 0.0
) -> StepSignal:
    """Return a signal whose distance from some values is multiplied by `size`, and that is shifted."""
    steps = [(0.0, signal.start), *signal.steps]
    (_, start), *later = ((t, around + size * (np.asarray(v) - around) + shift) for t, v in steps)
    return StepSignal(start, tuple(later))


class Worn:
    """A controller behind sensors with a resolution and actuators with backlash.

    Args:
        controller: Controller that sees what the sensors show, and as input its own last command.
        grain: Distance of the values that each output can have, shape (n_y,); 0 for any.
        play: Half of the backlash of each input, shape (n_u,).
        inputs: Inputs, with their ranges.
    """

    def __init__(self, controller: Controller, grain: Y, play: U, inputs: Sequence[Channel]) -> None:
        self.controller, self.play, self.T_s = controller, play, controller.T_s
        self.rounded, self.grain = grain > 0, np.where(grain > 0, grain, 1.0)
        self._low, self._high = np.array([c.low for c in inputs]), np.array([c.high for c in inputs])
        self._command: U | None = None

    @classmethod
    def of(
        cls,
        make: ControllerFactory,
        grain: Y,
        play: U,
        inputs: Sequence[Channel],
        theta: Float[np.ndarray, " n"],
    ) -> "Worn":
        """Return the controller of a physical θ, shape (n,), behind these sensors and actuators."""
        return cls(make(theta), grain, play, inputs)

    def move(self, measurement: Measurement) -> Move:
        """Decide by what the sensors show; return where the actuators go."""
        m = measurement
        y = np.where(self.rounded, (m.y / self.grain).round() * self.grain, m.y)
        move = self.controller.move(Measurement(m.t, m.x, self._seen(m.u), m.d, m.y_ref, y))
        if move.solved:
            self._command = move.u
        # What is NaN stays so: it tells that the controller failed.
        reached = np.minimum(np.maximum(m.u, move.u - self.play), move.u + self.play)
        return Move(reached, solved=move.solved, iterations=move.iterations)

    def _seen(self, u: U) -> U:
        """Return the last command within range and rate, given the actuators, shape (n_u,).

        Nobody measures the backlash: to an anti-windup it would look like saturation for ever.
        """
        if self._command is None:
            return u
        followed = np.clip(self._command, u - self.play, u + self.play)
        return np.asarray(np.clip(followed, self._low, self._high))


# --- What varies in the closed loops that come with prefcal.


def of_loop(loop: Loop, space: KnobSpace) -> Subject:
    """Return what varies of a loop whose θ are in `space`; a model in its controller stays."""
    plant, law = loop.plant, isinstance(loop.controller, TunedPID | TunedLQR)
    limits, targets = [plant.states[k] for k in plant.measured], list(enumerate(np.ravel(loop.target.start)))
    moves = tuple(_moves(plant, loop.task, limits, targets))
    build, make = partial(_built_loop, loop, space), partial(controller_of, loop)
    varied = VariedLoop(loop.plant, loop.task, build, make, wears=law, moves=moves)
    ideal = "sensors and actuators of an MPC are ideal here: only noise and ranges are varied"
    near = "start, size and direction of the step are not varied: a limit is near the target"
    return varied.subject(*([] if law else [ideal]), *([] if moves else [near]))


def _built_loop(loop: Loop, space: KnobSpace, plant: Plant, task: Task, grain: Y, play: U) -> Any:
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


@dataclass(frozen=True, slots=True)
class Designed:
    """A kind of controller that is designed for the plant of the study, whatever plant it meets."""

    controller: Tunable
    plant: CompiledPlant
    task: Task

    def make(self, values: KnobValues, plant: CompiledPlant, task: Task, T_s: float) -> Gains | Controller:
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
    """A compiled law as a `Controller`; `T_s` is in the plant's unit of time."""

    def __init__(self, gains: Gains, T_s: float) -> None:
        self._gains, self.T_s = gains, T_s
        self._memory = np.zeros((len(gains.rows), MEMORY))

    def move(self, measurement: Measurement) -> Move:
        """Decide the inputs from the measured outputs."""
        u, y = np.array(measurement.u, dtype=float), np.array(measurement.y, dtype=float)
        r = np.array(measurement.y_ref, dtype=float)
        _act(self._gains.law, np.array(self._gains.rows), r, y, self._memory, float(self.T_s), u)
        return Move(u)


# --- Find what of a source can vary: its loop, the arguments of its run, or what an optional world says.

RIG = "it runs on a rig or a live plant, which cannot be varied: verify a model of it"
_OURS = ("theta", "seed", "space")


def subject_of(source: Source, space: KnobSpace) -> Subject:
    """Return what of a source can vary, for θ in `space`.

    Raises:
        ScenarioError: If nothing can; the message says what to add.
    """
    if isinstance(source, WithKPIs):
        return subject_of(source.source, space).measured_as(source)
    if isinstance(source, Maneuvers):
        return of_maneuvers(source, {n: subject_of(each, space) for n, each in source.maneuvers.items()})
    if source.asks:
        raise ScenarioError(RIG)
    function = function_of(source)
    bare = function.func if isinstance(function, partial) else function
    loop = getattr(bare, "__self__", bare)
    if isinstance(loop, Loop):
        return of_loop(loop, space)
    if isinstance(loop, ClosedLoop):
        return of_closed_loop(loop)
    world = world_of(loop)
    if world is not None and world.varies:
        varied: Subject = world.inside("prefcal_scenarios").subject_of(loop)
        return varied
    return _CASES.get(getattr(bare, "__module__", ""), of_function)(function)


def of_function(function: Any) -> Subject:
    """Return the numbers that a run takes as arguments with a default, besides θ and the seed.

    A whole one may be a count, which cannot change a little.
    """
    given = signature(function).parameters.values() if callable(function) else ()
    found = {p.name: p.default for p in given if p.name not in _OURS and is_number(p.default)}
    numbers = {name: float(value) for name, value in found.items() if isinstance(value, float)}
    whole = ", ".join(name for name in found if name not in numbers)
    said = ["only arguments of its run are varied: sensors, actuators and the task are in its code"]
    said += [f"whole numbers are not varied, write 2.0 for 2 where they can be: {whole}"] if whole else []
    if not numbers:
        raise ScenarioError(
            "nothing of it can be varied, since it is only a function of θ: give the parameters of its plant "
            "as arguments with a default, such as run(theta, seed=0, mass=1.2), or run it as a ClosedLoop"
        )
    return Subject(
        tuple(Factor.around(name, "parameter", CHANGE, value) for name, value in numbers.items()),
        tuple(said),
        partial(_with_arguments, function),
    )


def _with_arguments(function: Any, values: Values) -> Source:
    return Function(partial(function, **values))


def _reactor(function: Any) -> Subject:
    """Return what varies of the reactor; `function` is its run, perhaps for other ranges.

    An exponent changes the rate by e^0.3 for 1 %, and the gas constant does not change.
    """
    given = {k: v for k, v in getattr(function, "keywords", {}).items() if k == "space"}
    found = of_closed_loop(ClosedLoop(cstr_env(), partial(controller, **given), compute_kpis))
    factors = within(found.factors, {"E": 0.01, "R": 0.0})
    return replace(found, factors=tuple(replace(each, stated=False) for each in factors))


def _overtaking(function: Any) -> Subject:
    """Return the car's wheelbase, which the MPC does not know, and where it starts."""
    options = getattr(function, "keywords", {}).get("options") or OvertakeOptions()
    factors = (
        Factor.around("wheelbase", "parameter", CHANGE, options.wheelbase, "m", (LEAST, np.inf)),
        Factor("distance at the start", "task", 0.0, -5.0, 5.0, "m"),
        Factor("start beside the center line", "task", 0.0, -0.3, 0.3, "m"),
        Factor("heading at the start", "task", 0.0, -0.03, 0.03, "rad"),
    )
    said = "sensors and actuators of the car are ideal, and the obstacle drives as in the paper"
    return Subject(factors, (said,), partial(_in_scene, function, options, factors[1:]))


def _in_scene(function: Any, options: OvertakeOptions, start: tuple[Factor, ...], values: Values) -> Source:
    x, y, heading = (x + values.get(f.name, 0.0) for x, f in zip(options.x0, start, strict=True))
    wheelbase = values.get("wheelbase", options.wheelbase)
    return Function(partial(function, options=replace(options, x0=(x, y, heading), wheelbase=wheelbase)))


_CASES: Mapping[str, Callable[[Any], Subject]] = {
    "prefcal_scenarios.cases.cstr": _reactor,
    "prefcal_scenarios.cases.overtake.scenario": _overtaking,
}
"""What varies in the case studies, by the module of their run."""
