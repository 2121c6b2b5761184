"""What varies in a closed loop of any plant and controller."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.margins import Margins, margins
from prefcal_env.envs.closed_loop import ClosedLoop, ControllerFactory
from prefcal_env.envs.dead_time import dead_times
from prefcal_env.envs.fit import tracked_of
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.step_signal import StepSignal
from prefcal_env.envs.task import Signal, Task
from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.control import Controller, Measurement, Move
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.plants.jacobians import U, X, Y
from prefcal_env.plants.plant import Plant
from prefcal_env.sources.function import Function
from prefcal_scenarios.described.pid.kpis import Measure

from .factor import NOT_NEGATIVE, Factor, Values
from .plants import LEAST, SIZE, factors_of, varied_plant
from .rest import at_rest, rest
from .subject import Subject

_WEAR = (-0.5, 1.0)
"""Relative change of noise."""
_NOISE, _GRAIN, _PLAY, _OFFSET = 0.002, 0.005, 0.005, 0.1
"""Largest noise of sensors without any, and resolution, as shares of the largest step; half backlash
of actuators, as a share of the range; change of the operating point, as a share of the step."""
NOISE, GRAIN, PLAY, LOAD = "noise", "resolution of sensors", "backlash", "size of the load"
JITTER, _JITTER, _MOST = "sampling jitter", 0.1, 0.49
"""Largest jitter, as a share of the period: the usual and the possible one."""
MOVE, SHIFT, REFERENCE, DIRECTION = "rate of the actuators", "start", "size of the step", "direction"
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
    varied = VariedLoop(env.plant, env.task, build, loop.controller, jitters=not discrete)
    return varied.subject("references and start are not varied: the KPIs are those of this step")


def _built(loop: ClosedLoop, plant: Plant, task: Task, grain: Y, play: U) -> ClosedLoop:
    worn = partial(Worn.of, loop.controller, grain, play, plant.inputs)
    make = worn if grain.any() or play.any() else loop.controller
    kpis = loop.kpis.around(plant, task) if isinstance(loop.kpis, Measure) else loop.kpis
    return ClosedLoop(PlantEnv(plant, task), make, kpis)


@dataclass(frozen=True, slots=True, eq=False)
class VariedLoop:
    """A closed loop whose plant, sensors, actuators and task vary, while its controller stays.

    A varied plant starts at rest with the outputs of the study: its controller had brought it there.

    Args:
        plant: Plant of the study.
        task: Task of the study.
        build: What a loop does.
        controller: Function of θ that makes the controller.
        wears: Whether sensors can have a resolution, and actuators backlash.
        jitters: Whether periods can differ.
        moves: What varies of the step: `SHIFT`, `REFERENCE`, `DIRECTION` or less.
    """

    plant: Plant
    task: Task
    build: Build
    controller: ControllerFactory
    wears: bool = True
    jitters: bool = False
    moves: tuple[str, ...] = ()

    def subject(self, *said: str) -> Subject:
        """Return what varies; `said` is what does not, beside what follows from plant and task."""
        late = bool(dead_times(self.plant).any())
        missing = {
            "the plant has no dead time, and none is added: see the delay margin": late,
            "no rate of an actuator is stated, so none is varied": self.task.max_move is not None,
            "the task has no steps of a load, so none is varied": self._loaded,
            "sampling jitter is not varied: a period has one length": self.jitters,
        }
        left_out = (*said, *(text for text, there in missing.items() if not there))
        factors = (*factors_of(self.plant), *self._others())
        return Subject(factors, left_out, self.at, self.margins)

    def at(self, values: Values) -> Function:
        """Return the run of the loop with these values."""
        plant = varied_plant(self.plant, values)
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
        steps = (
            Factor.around(REFERENCE, "task", SIZE, possible=(LEAST, np.inf)),
            Factor(SHIFT, "task", 0.0, -_OFFSET, _OFFSET, "of the step"),
            Factor(DIRECTION, "task", 1.0, -1.0, 1.0, ends=True),
        )
        yield from (factor for factor in steps if factor.name in self.moves)

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
        if LOAD in values and isinstance(d, StepSignal):
            d = _scaled(d, np.asarray(d.start, dtype=float), values[LOAD])
        x0, u0 = self._rest(plant, values.get(SHIFT, 0.0))
        y_ref: Signal = task.y_ref
        if self.moves and isinstance(y_ref, StepSignal):
            size = values.get(REFERENCE, 1.0) * values.get(DIRECTION, 1.0)
            y_ref = _scaled(y_ref, self.start, size, plant.g(x0, u0, task.disturbance(0.0)) - self.start)
        moves = None if task.max_move is None else task.max_move * values.get(MOVE, 1.0)
        if self._noisy or noise.any():
            task = replace(task, noise=noise)
        jitter = max(task.jitter, values.get(JITTER, 0.0))
        return replace(task, x0=x0, u0=u0, y_ref=y_ref, d=d, max_move=moves, jitter=jitter)

    def _rest(self, plant: Plant, shift: float) -> tuple[X, U]:
        """Return where a varied plant rests with the outputs of the start; the start if nowhere.

        Args:
            plant: Varied plant.
            shift: What the first output is moved by, in steps.
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
