"""What varies in a closed loop of any plant and controller."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.dead_time import delays_of
from prefcal_env.envs.fit import tracked_of
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.step_signal import StepSignal
from prefcal_env.envs.task import Task
from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.control import Controller, Measurement, Move
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.knobs.knob import is_number
from prefcal_env.plants.disturbed import Disturbed
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearPlant

from .factor import Factor, Values
from .rest import at_rest, rest

_CHANGE, _SIZE, _WEAR, _RANGE = 0.1, 0.2, (-0.5, 1.0), 0.1
"""Relative changes: of parameters; of dead time and loads; of noise; of an input's range."""
_GRAIN, _NOISE, _PLAY = 0.005, 0.002, 0.005
"""Largest resolution and noise of sensors without any, as shares of the largest step, and half
backlash of actuators, as a share of the range."""
SPEED, DELAY, NOISE, GRAIN, PLAY, LOAD, MOVE = (
    "all time constants",
    "dead time",
    "noise",
    "resolution of sensors",
    "backlash",
    "size of the load",
    "rate of the actuators",
)
_NOT_PARAMETERS = ("max_step", "dead_time")
_EXPONENTS = {"E": 0.01, "R": 0.0}
"""Relative changes of parameters of the reactor: an exponent changes the rate by e^0.3 for 0.01,
and the gas constant does not change."""


class PlantSubject:
    """A `ClosedLoop` whose plant, sensors, actuators and load vary, while its controller stays.

    Parameters are the numbers of a plant that is a dataclass, as `CSTR`. Of equations without
    named parameters, as in a `FunctionPlant`, all time constants change together, and the gain of
    each input; of matrices the time constant of each state.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        env = loop.env
        if not isinstance(env, PlantEnv):
            raise ScenarioError(
                "only the loop of a PlantEnv can be varied, since it says its plant and task: "
                f"make its environment one, got {type(env).__name__}"
            )
        self.loop, self.plant, self.task = loop, env.plant, env.task
        self.inner: Plant = self.plant.plant if isinstance(self.plant, Disturbed) else self.plant
        said = [
            "sampling jitter is not varied: a period has one length",
            "references and start are not varied: the KPIs are those of this step",
        ]
        if not any((*delays_of(self.inner)[0], *np.ravel(getattr(self.inner, "entry_delay", ())))):
            said.append("the plant has no dead time, and none is added: see the delay margin")
        if env.task.max_move is None:
            said.append("no rate of an actuator is stated (max_move of the task), so none is varied")
        if not isinstance(env.task.d, StepSignal):
            said.append("no load steps (d of the task is no StepSignal), so none is varied")
        self.left_out = tuple(said)
        self.factors = (*self._of_plant(), *self._of_parts())

    def at(self, values: Values) -> Callable[..., Experiment]:
        """Return the run of the varied loop."""
        plant, task = self._varied(values), self._task(values)
        found = self._rest(plant, task)
        task = replace(task, x0=found[0], u0=found[1])
        rough = [values.get(name, 0.0) for name in (GRAIN, PLAY)]
        spans = np.array([c.high - c.low for c in plant.inputs])
        play = rough[1] * np.where(np.isfinite(spans), spans, 0.0)
        make = self.loop.controller

        def worn(theta: Float[np.ndarray, " n"]) -> Controller:
            made: Controller = make(theta)
            return Worn(made, rough[0] * self._step, play) if any(rough) else made

        return ClosedLoop(PlantEnv(plant, task), worn, self.loop.kpis)

    def _of_plant(self) -> Iterator[Factor]:
        """Yield what varies of the plant itself."""
        inner = self.inner
        if isinstance(inner, LinearPlant):
            if not inner.sample_time:
                rows = np.column_stack([inner.system.A, inner.system.B])
                states = zip(inner.states, rows, strict=True)
                real = (c for c, row in states if (np.abs(row) != 0).sum() > 1 or abs(row).max() != 1)
                yield from (Factor.around(_constant(c), "parameter", _CHANGE) for c in real)
        elif parameters := dict(_numbers(inner)):
            for name, value in parameters.items():
                change = _EXPONENTS.get(name, _CHANGE)
                yield Factor.around(name.replace("_", " "), "parameter", change, value)
        else:
            yield Factor.around(SPEED, "parameter", _CHANGE)
        if isinstance(inner, LinearPlant) or not dict(_numbers(inner)):
            yield from (Factor.around(f"gain of {c.name}", "parameter", _CHANGE) for c in inner.inputs)

    def _of_parts(self) -> Iterator[Factor]:
        """Yield what varies of dead time, sensors, actuators and load."""
        task = self.task
        if any(delays_of(self.inner)[0]):
            yield Factor.around(DELAY, "dead time", _SIZE)
        if task.noise is not None and np.any(task.noise):
            yield Factor.around(NOISE, "sensor", _WEAR)
        else:
            yield Factor(NOISE, "sensor", 0.0, 0.0, _NOISE)
        yield Factor(GRAIN, "sensor", 0.0, 0.0, _GRAIN)
        for c in self.plant.inputs:
            if np.isfinite(c.high - c.low):
                yield Factor(f"range of {c.name}", "actuator", 1.0, 1 - _RANGE, 1.0)
        yield Factor(PLAY, "actuator", 0.0, 0.0, _PLAY)
        if task.max_move is not None:
            yield Factor.around(MOVE, "actuator", _SIZE)
        if isinstance(task.d, StepSignal) and task.d.steps:
            yield Factor.around(LOAD, "task", _SIZE)

    def _varied(self, values: Values) -> Plant:
        """Return the plant with these values, with its loads."""
        inner = _with_parameters(self.inner, values)
        inputs = tuple(narrowed(c, values.get(f"range of {c.name}", 1.0)) for c in self.plant.inputs)
        if isinstance(self.plant, Disturbed):
            return self.plant.around(inner, inputs)
        return Disturbed(inner, inputs=inputs)

    def _task(self, values: Values) -> Task:
        """Return the task with other noise, rate and load."""
        task, d = self.task, self.task.d
        if task.noise is not None and np.any(task.noise):
            noise = values.get(NOISE, 1.0) * task.noise
        else:
            noise = values.get(NOISE, 0.0) * self._step
        if LOAD in values:
            assert isinstance(d, StepSignal)
            start, size = np.asarray(d.start, dtype=float), values[LOAD]
            d = StepSignal(start, tuple((t, start + size * (np.asarray(v) - start)) for t, v in d.steps))
        moves = None if task.max_move is None else task.max_move * values.get(MOVE, 1.0)
        return replace(task, noise=noise if np.any(noise) else None, d=d, max_move=moves)

    @property
    def _step(self) -> Float[np.ndarray, " n_y"]:
        """Largest change of each output's reference, from the start, shape (n_y,); 0 for none."""
        task = self.task
        times = [0.0, *(t for t, _ in task.y_ref.steps)] if isinstance(task.y_ref, StepSignal) else [0.0]
        start = self.plant.g(task.x0, task.u0, task.disturbance(0.0))
        changes = np.array([np.abs(task.reference(t) - start) for t in times])
        return np.asarray(np.nan_to_num(changes).max(axis=0))

    def _rest(self, plant: Plant, task: Task) -> tuple[X, U]:
        """Return where the varied plant rests with the outputs of the start; the start if nowhere."""
        d, start = task.disturbance(0.0), (task.x0, task.u0)
        try:
            if not at_rest(self.plant, *start, d):
                return start
            y = np.asarray(self.plant.g(*start, d))
            stepping = [i for i in tracked_of(task) if self._step[i] > 0]
            chosen = stepping[: len(plant.inputs)]
            return rest(plant, *start, d, chosen, y[chosen].tolist()) or start
        except PlantError:  # a discrete plant without ẋ
            return start


class Worn:
    """A controller behind sensors with a resolution and actuators with backlash.

    Args:
        controller: Controller that sees what the sensors show.
        grain: Distance of the values that each output can have, shape (n_y,); 0 for any.
        play: Half of the backlash of each input, shape (n_u,).
    """

    def __init__(
        self, controller: Controller, grain: Float[np.ndarray, " n_y"], play: Float[np.ndarray, " n_u"]
    ) -> None:
        self.controller, self.grain, self.play = controller, grain, play

    @property
    def T_s(self) -> float:
        """Sampling time of the controller."""
        return self.controller.T_s

    def move(self, measurement: Measurement) -> Move:
        """Decide by what the sensors show; return where the actuators go."""
        m, grain = measurement, np.where(self.grain > 0, self.grain, 1.0)
        y = np.where(self.grain > 0, np.round(m.y / grain) * grain, m.y) if len(m.y) else m.y
        move = self.controller.move(replace(m, y=y))
        reached = np.clip(m.u, move.u - self.play, move.u + self.play)
        return replace(move, u=np.where(np.isfinite(move.u), reached, move.u))


@dataclass(frozen=True, eq=False)
class Scaled:
    """A plant that is slower or faster by one factor, and whose inputs act more or less, or later.

    Args:
        plant: Plant.
        speed: Factor of all rates.
        gains: Factor of each input, shape (n_u,).
        input_delay: Dead time of each input.
    """

    plant: Plant
    speed: float
    gains: Float[np.ndarray, " n_u"]
    input_delay: tuple[float, ...]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "plant":
            raise AttributeError(name)
        return getattr(self.plant, name)

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return self.speed * self.plant.f(x, self.gains * u, d)

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs."""
        return self.plant.g(x, self.gains * u, d)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives."""
        J = self.plant.jacobians(x, self.gains * u, d)
        return Jacobians(self.speed * J.A, self.speed * J.B * self.gains, J.C, J.D * self.gains)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`."""
        return self.plant.hold(x, self.gains * u, d, np.asarray(times) * self.speed)

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input adds to the outputs."""
        found: np.ndarray = self.plant.entries(x, self.gains * u, d)  # type: ignore[attr-defined]
        return found


def _constant(state: Channel) -> str:
    return f"time constant of {state.name}"


def narrowed(c: Channel, share: float) -> Channel:
    """Return an input that has only a share of its range, around its middle."""
    if share == 1.0:
        return c
    middle, half = (c.high + c.low) / 2, share * (c.high - c.low) / 2
    return replace(c, low=middle - half, high=middle + half)


def _numbers(value: Any) -> Iterator[tuple[str, float]]:
    """Yield the positive numbers of a dataclass or named tuple, also of those in it, by name."""
    names = [f.name for f in fields(value)] if is_dataclass(value) else getattr(value, "_fields", ())
    for name in names:
        each = getattr(value, name)
        if isinstance(each, float) and is_number(each) and 0 < each < np.inf and name not in _NOT_PARAMETERS:
            yield name, each
        elif is_dataclass(each) or hasattr(each, "_fields"):
            yield from _numbers(each)


def _with_numbers(value: Any, values: Values) -> Any:
    """Return a dataclass or named tuple with other numbers."""
    inner = [f.name for f in fields(value)] if is_dataclass(value) else value._fields
    changes: dict[str, Any] = {}
    for name in inner:
        each = getattr(value, name)
        if isinstance(each, float) and name.replace("_", " ") in values:
            changes[name] = values[name.replace("_", " ")]
        elif is_dataclass(each) or hasattr(each, "_fields"):
            changes[name] = _with_numbers(each, values)
    made: Any = value._replace(**changes) if hasattr(value, "_replace") else replace(value, **changes)
    return made


def _with_parameters(inner: Plant, values: Values) -> Plant:
    """Return a plant with other parameters, time constants, gains and dead time."""
    gains = np.array([values.get(f"gain of {c.name}", 1.0) for c in inner.inputs])
    speed, late = 1 / values.get(SPEED, 1.0), values.get(DELAY, 1.0)
    if isinstance(inner, LinearPlant):
        rates = np.array([1 / values.get(_constant(c), 1.0) for c in inner.states])
        inner = inner if (rates == 1).all() else inner.with_rates(rates)
    elif dict(_numbers(inner)):
        inner = _with_numbers(inner, values)
    if (gains == 1).all() and speed == late == 1:
        return inner
    return Scaled(inner, speed, gains, tuple(late * each for each in delays_of(inner)[0]))
