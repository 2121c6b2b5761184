"""What varies in a closed loop from run to run: its plant, sensors, actuators and task."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel, Controller, Measurement, Move
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y
from prefcal_env.plants.plant import ADDED, Disturbed, Plant
from prefcal_env.plants.systems import DEAD_TIMES, Ensemble, LinearPlant, local_system, scale_times
from prefcal_env.sources.source import Source, Varied
from prefcal_env.sources.varied import (
    CHANGE,
    LEAST,
    NARROWER,
    NOT_NEGATIVE,
    PLACES,
    SIZE,
    Factor,
    LeftOut,
    Unheld,
    Values,
)
from prefcal_env.units import conversion

from .plant_env import dead_times, tracked_of
from .task import Signal, StepSignal, Task, acts_at

# --- The steady state of a varied plant: it starts where its controller had brought it.

_STEPS, _EXACT, _RESTS, _NEAR = 30, 1e-13, 1e-9, 1e-5
"""Most steps of Newton's method; what counts as rest at once, as its last step, and as rest at all."""


def rest(
    plant: Plant, x: X, u: U, d: Float[np.ndarray, " n_d"], outputs: Sequence[int], aims: Sequence[float]
) -> tuple[X, U] | None:
    """Return a steady state at which some outputs have given values, or None.

    It is found by Newton's method from (x, u), with the smallest step if several would do.

    Args:
        x: State near it, shape (n_x,).
        u: Input near it, shape (n_u,).
        d: Measured disturbances.
        outputs: Indices of outputs, at most as many as inputs.
        aims: Their values.
    """
    x, u, n, chosen = np.array(x, dtype=float), np.array(u, dtype=float), len(x), list(outputs)
    scale = 1.0 + np.abs(np.concatenate([x, u]))
    for _ in range(_STEPS):
        try:
            J = plant.jacobians(x, u, d)
            left = np.concatenate([plant.f(x, u, d), plant.g(x, u, d)[chosen] - aims])
        except (ArithmeticError, PlantError):
            return None
        rows = np.block([[J.A, J.B], [J.C[chosen], J.D[chosen]]])
        if not (np.isfinite(rows).all() and np.isfinite(left).all()):
            return None
        if np.all(np.abs(left) <= _EXACT * (1 + np.abs(rows) @ scale)):
            return x, u
        step = scale * np.linalg.lstsq(rows * scale, -left, rcond=1e-12)[0]
        x, u = x + step[:n], u + step[n:]
        if np.abs(step / scale).max() <= _RESTS:
            near = np.abs(left) <= _NEAR * (1 + np.abs(rows) @ scale)
            return (x, u) if near.all() else None
    return None


def at_target(plant: Plant, task: Task) -> Task | None:
    """Return the task at rest at its last reference; None if the plant cannot rest there within its limits.

    A linear plant is the same everywhere, so for it there is none either.
    """
    d, aims = task.disturbance(0.0), task.reference(task.horizon)
    if isinstance(getattr(plant, "plant", plant), LinearPlant):
        return None
    chosen = list(tracked_of(task)[: len(plant.inputs)])
    found = rest(plant, task.x0, task.u0, d, chosen, aims[chosen].tolist())
    if found is None or not all(c.low < u < c.high for c, u in zip(plant.inputs, found[1], strict=True)):
        return None
    return replace(task, x0=found[0], u0=found[1], y_ref=aims)


def at_rest(plant: Plant, x: X, u: U, d: Float[np.ndarray, " n_d"]) -> bool:
    """Return whether a plant hardly moves at a point, in its unit of time."""
    return bool(np.abs(plant.f(x, u, d)).max(initial=0.0) <= _NEAR * (1 + np.abs(x).max(initial=0.0)))


# --- What varies of a plant: its parameters, dead time and the ranges of its inputs.

SPEED, DELAY = "all time constants", "dead time"
INSIDE = "numbers inside the equations, one by one"
"""What does not vary of a plant that is code."""
MODELED, STATED = "times the modeled", "times the stated"  # units of what is multiplied by its factor
AT_ZERO = 1e-3  # magnitude below which a discrete pole is one at 0
_NOT_PARAMETERS = ("max_step", "dead_time")


def latest(plant: Plant, measuring: float | Sequence[float] = 0.0) -> float:
    """Return the longest dead time from an input to a measured output, whose sensors add `measuring`."""
    return float((dead_times(plant) + np.reshape(measuring, (-1, 1))).max())


def waits_inside(plant: Plant) -> bool:
    """Return whether states of a discrete plant only hand on what came before: poles at 0."""
    own = plant.plant if isinstance(plant, Disturbed) else plant
    if not (isinstance(own, LinearPlant) and own.sample_time):
        return False
    return bool((np.abs(np.linalg.eigvals(own.system.A)) < AT_ZERO).any())


def factors_of(plant: Plant, measuring: float | Sequence[float] = 0.0) -> Iterator[Factor]:
    """Yield what varies of a plant: parameters, dead time, and the ranges of its inputs.

    Parameters are the numbers of one that is a dataclass, as `CSTR`. Of matrices they are the time
    constant of each state and the gain of each input, of other equations all time constants together.
    So are those of states without names: a row of a transfer function's matrices is no parameter.
    Dead time of inputs, outputs, entries and sensors (`measuring`) varies together, by the same share:
    the factor is the longest one from an input to an output. Of a plant that was identified, all this
    varies as its record leaves it open: by the number of one of the plants that explain it.
    """
    own = plant.plant if isinstance(plant, Disturbed) else plant
    if sample := sample_of(own):
        count = len(sample.systems)
        name, told, ends = _describe_sample(sample), f"identified: {sample.told}", (1.0, float(count))
        yield Factor(name, "parameter", sample.best + 1.0, *ends, f"of {count}", False, ends, 1.0, told=told)
    else:
        yield from _parameters(own, measuring)
    for c in plant.inputs:
        if np.isfinite(c.high - c.low):
            yield Factor(_range(c), "actuator", 1.0, 1 - NARROWER, 1.0, STATED, possible=(LEAST, 1.0))


def sample_of(plant: Plant) -> Ensemble | None:
    """Return the plants of which an identified plant is one; None if it was not identified."""
    own = plant.plant if isinstance(plant, Disturbed) else plant
    return getattr(own, "sample", None)


def hides_numbers(plant: Plant) -> bool:
    """Return whether a plant is made of equations in code, whose numbers nobody else can see."""
    own = plant.plant if isinstance(plant, Disturbed) else plant
    return not isinstance(own, LinearPlant) and _matrices(own) is None and not any(_numbers(own))


def _describe_sample(sample: Ensemble) -> str:
    return f"plant identified from {sample.record}"


def _parameters(own: Plant, measuring: float | Sequence[float]) -> Iterator[Factor]:
    """Yield the parameters of a plant and its dead time."""
    matrices, numbers = _matrices(own), list(_numbers(own))
    if matrices is not None:
        for state, a, b in zip(own.states, *matrices, strict=False):
            # A row such as ẋ = v says what a state is: it has no parameter.
            if b.any() or not np.isin(np.abs(a), (0.0, 1.0)).all():
                yield _parameter(_constant(state))
    elif numbers:
        yield from (_parameter(*each) for each in numbers)
    elif own.states and not getattr(own, "sample_time", 0.0):
        yield _parameter(SPEED)
    if matrices is not None or not numbers:
        centers = _centers(own) if matrices is None else np.zeros(len(own.inputs))
        for c, center in zip(own.inputs, centers.tolist(), strict=True):
            yield _parameter(_gain(c), unit=f"{MODELED}, about {_in(center, c)}" if center else MODELED)
    if late := latest(own, measuring):
        found = Factor.around(DELAY, "dead time", SIZE, late, own.time_unit, NOT_NEGATIVE)
        step = getattr(own, "sample_time", 0.0)  # between its samples, a discrete plant sees nothing
        yield found.stepped(step) if step else found


def _parameter(name: str, value: float = 1.0, unit: str = MODELED) -> Factor:
    """Return a parameter of a plant, which is above 0 and stays so."""
    return Factor.around(name, "parameter", CHANGE, value, unit, possible=(LEAST * value, np.inf))


def varied_plant(plant: Plant, values: Values, later: float = 1.0) -> Disturbed:
    """Return a plant with other parameters and ranges of its inputs, and `later` times its dead time."""
    own = plant.plant if isinstance(plant, Disturbed) else plant
    known = own.rest if isinstance(own, LinearPlant) else None
    shares = [values.get(_range(c), 1.0) for c in plant.inputs]
    centers = known[0].tolist() if known else [None] * len(shares)
    inputs = tuple(map(_narrow, plant.inputs, shares, centers))
    if isinstance(plant, Disturbed):
        return plant.around(_change(plant.plant, values, later), inputs)
    return Disturbed(_change(plant, values, later), inputs=inputs)


def _change(plant: Plant, values: Values, later: float) -> Plant:
    """Return a plant with other parameters, time constants, gains and dead time."""
    if isinstance(plant, LinearPlant) and (sample := sample_of(plant)):
        return plant.another(int(values.get(_describe_sample(sample), sample.best + 1.0)) - 1)
    gains = np.array([values.get(_gain(c), 1.0) for c in plant.inputs])
    rates = np.array([1 / values.get(_constant(c), 1.0) for c in plant.states])
    speed, named = 1 / values.get(SPEED, 1.0), plant
    if _matrices(plant) is None and any(_numbers(plant)):
        named = _with_numbers(plant, values)
    if scaled := getattr(named, "scaled", None):
        made: Plant = scaled(speed * rates, gains, later)
        return made
    if (gains == 1).all() and speed == later == 1:
        return named
    return ScaledPlant(named, speed, gains, (1 - gains) * _centers(plant), later)


@dataclass(frozen=True, eq=False)
class ScaledPlant:
    """A plant that is slower or faster by one factor, and whose inputs act more or less, or later."""

    plant: Plant
    speed: float  # factor of all rates
    gains: Float[np.ndarray, " n_u"]  # factor of each input, shape (n_u,)
    offset: Float[np.ndarray, " n_u"]  # what is added to each input then, shape (n_u,)
    later: float  # factor of all dead times

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("plant", "later"):
            raise AttributeError(name)
        found = getattr(self.plant, name)
        return scale_times(found, self.later) if name in DEAD_TIMES else found

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return self.speed * self.plant.f(x, self.acting(u), d)

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs."""
        return self.plant.g(x, self.acting(u), d)

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input adds to the outputs, if the plant can tell."""
        found: np.ndarray = self.plant.entries(x, self.acting(u), d)  # type: ignore[attr-defined]
        return found

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives."""
        J = self.plant.jacobians(x, self.acting(u), d)
        return Jacobians(self.speed * J.A, self.speed * J.B * self.gains, J.C, J.D * self.gains)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`."""
        return self.plant.hold(x, self.acting(u), d, np.asarray(times) * self.speed)

    def acting(self, u: U) -> U:
        """Return what the inputs `u` do to the plant, as inputs of the plant without this gain."""
        return np.asarray(self.gains * u + self.offset)


def _centers(plant: Plant) -> Float[np.ndarray, " n_u"]:
    """Return the value of each input at which its gain changes nothing, shape (n_u,).

    That is 0, but for temperatures the middle of their range: a tenth of 300 K is no error of a cooler.
    """
    warm = [conversion(c.unit, "K", difference=True) is not None for c in plant.inputs]
    ends = [(c.low + c.high) / 2 if is_warm else 0.0 for c, is_warm in zip(plant.inputs, warm, strict=True)]
    return np.where(np.isfinite(ends), ends, 0.0)


def _matrices(plant: Plant) -> tuple[np.ndarray, np.ndarray] | None:
    """Return A and B of a plant whose rows mean something to people, if it says them."""
    return getattr(plant, "named_matrices", None)


def _narrow(c: Channel, share: float, center: float | None) -> Channel:
    """Return an input that has only a share of its range, around `center`, or None for its middle."""
    if share == 1.0:
        return c
    if center is not None:  # where the plant rests, which may be a limit: it must stay in the range
        return replace(c, low=center - share * (center - c.low), high=center + share * (c.high - center))
    middle, half = (c.high + c.low) / 2, share * (c.high - c.low) / 2
    return replace(c, low=middle - half, high=middle + half)


def _range(c: Channel) -> str:
    return f"range of {c.name}"


def _constant(state: Channel) -> str:
    return f"time constant of {state.name}"


def _gain(c: Channel) -> str:
    return f"gain of {c.name}"


def _words(value: Any, name: str) -> str:
    """Return the plain name of a parameter of a dataclass or named tuple, as its `words` may say it."""
    return _said(value, "words", name) or name.replace("_", " ")


def _said(value: Any, attribute: str, name: str) -> str:
    """Return what a mapping of a dataclass or named tuple says of a parameter; "" without one."""
    said = getattr(value, attribute, None)
    return str(said.get(name, "")) if isinstance(said, Mapping) else ""


def _parts(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass or named tuple that may be parameters; none of anything else."""
    names = [f.name for f in fields(value)] if is_dataclass(value) else getattr(value, "_fields", ())
    return {name: getattr(value, name) for name in names if name not in _NOT_PARAMETERS}


def _numbers(value: Any) -> Iterator[tuple[str, float, str]]:
    """Yield name, value and unit of positive numbers of a dataclass or named tuple, also of those in it."""
    for name, each in _parts(value).items():
        if isinstance(each, float) and 0 < each < np.inf:
            yield _words(value, name), each, _said(value, "units", name)
        else:
            yield from _numbers(each)


def _with_numbers(value: Any, values: Values) -> Any:
    """Return a dataclass or named tuple with other numbers."""
    changes: dict[str, Any] = {}
    for name, each in _parts(value).items():
        if isinstance(each, float) and (words := _words(value, name)) in values:
            changes[name] = values[words]
        elif _parts(each):
            changes[name] = _with_numbers(each, values)
    made: Any = value._replace(**changes) if hasattr(value, "_replace") else replace(value, **changes)
    return made


# --- Sensors, actuators and the task of a closed loop of any plant and controller.

_WEAR = (-0.5, 1.0)  # relative change of noise
_NOISE, _GRAIN, _BIAS, _PLAY, _OFFSET = 0.002, 0.005, 0.01, 0.01, 0.5
"""Largest noise of sensors without any, resolution and bias, as shares of the largest step; backlash of
actuators, the whole gap, as a share of the range; change of the operating point, as a share of the step."""
NOISE, GRAIN, BIAS, PLAY, LOAD = (
    "noise",
    "resolution of sensors",
    "bias of sensors",
    "backlash",
    "size of the load",
)
LAG, _LAG = "lag of the actuators", 0.1
"""Largest lag that nobody modeled, as a share of the dominant time constant."""
JITTER, _JITTER, _MOST = "sampling jitter", 0.1, 0.49
"""Largest jitter, as a share of the period: the usual and the possible one."""
MOVE, SHIFT, REFERENCE, DIRECTION = "rate of the actuators", "start", "size of the step", "sign of the step"
TURN, STEP = "sign of the load", "start, size and sign of the step"
BIGGER, _SAMPLES = "a larger load", 501  # instants at which a function of time is looked at
_MOVING = 0.1  # share of these instants from which on a function that changes there moves all the time
_LOADS = (BIGGER, 1 + SIZE), (TURN, -1.0)
LARGER, AHEAD, BACK = "a larger step", "start and target moved ahead", "start and target moved back"
STEPPED = (REFERENCE, SHIFT, DIRECTION)
IDENTIFIED = "identified: "
"""Begin of what the range of the noise follows from, if that is the noise of a record."""
_BEYOND, _BEHIND = 1.3, 0.3
"""Steps that are left free of what varies: beyond the target, for an overshoot, and behind the start."""
Build = Callable[[Disturbed, Task, Y, U], Source]
"""Function of plant, task, resolution of the sensors, shape (n_y,), and half backlash of the
actuators, shape (n_u,), that returns the loop; the controller stays as it is designed."""


@dataclass(frozen=True, slots=True)
class Moves:
    """What varies of the step, in steps of the study."""

    larger: float = 0.0  # most by which it is larger, as a share
    smaller: float = 0.0  # most by which it is smaller
    ahead: float = 0.0  # most by which it starts nearer to its target, or behind it
    back: float = 0.0  # most by which it starts farther away
    turned: bool = False  # whether it also goes in the other direction
    left_out: tuple[LeftOut, ...] = ()  # what else could vary, and which limit keeps it

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the factors."""
        there = bool(self.larger or self.smaller), bool(self.ahead or self.back), self.turned
        return tuple(name for name, varies in zip(STEPPED, there, strict=True) if varies)


@dataclass(frozen=True, slots=True)
class _Step:
    """The step of a task, and where limits of outputs, states and inputs end what can vary of it."""

    plant: Plant
    task: Task
    limits: Sequence[Channel]  # those of each output
    targets: Sequence[tuple[int, float]]  # index of an output and its reference after the step

    def ends(self, share: float, free: float) -> str:
        """Return which limit is nearer than `free` steps if outputs go this share of the step; "" if none."""
        x0, u0, d = self.task.x0, self.task.u0, self.task.disturbance(0.0)
        y0, aims = self.plant.g(x0, u0, d), list[float]()
        for k, target in self.targets:
            step, c = target - float(y0[k]), self.limits[k]
            aims.append(float(y0[k]) + share * step)
            left = np.copysign(free, share) * step
            if limit := _beyond(c, aims[-1] + left):
                near = "beyond" if _beyond(c, aims[-1]) else f"within {_in(abs(left), c)} of"
                return f"{c.name} would go to {_in(aims[-1], c)}, {near} its limit of {limit}"
        found = rest(self.plant, x0, u0, d, [k for k, _ in self.targets], aims)
        goal = ", ".join(
            f"{self.limits[k].name} {_in(aim, self.limits[k])}"
            for (k, _), aim in zip(self.targets, aims, strict=True)
        )
        if found is None:
            return f"no steady state is known at {goal}"
        channels = zip((*self.plant.states, *self.plant.inputs), np.concatenate(found), strict=True)
        lost = (f"{c.name} {_in(v, c)}, beyond its limit of {e}" for c, v in channels if (e := _beyond(c, v)))
        return next((f"{goal} would need {words}" for words in lost), "")


def _in(value: float, c: Channel) -> str:
    return f"{float(value):.4g} {c.unit}".rstrip().replace("-", "−")


def _beyond(c: Channel, value: float) -> str:
    """Return the limit of a channel that a value is beyond, in its unit; "" if none."""
    return "" if c.low <= value <= c.high else _in(c.high if value > c.high else c.low, c)


def moves_of(
    plant: Plant, task: Task, limits: Sequence[Channel], targets: Sequence[tuple[int, float]]
) -> Moves:
    """Return what can vary of the step: all where no limit is near and the plant can rest, else a part.

    Args:
        limits: Limits of each output.
        targets: Index of an output and its reference after the step, in the order of the loops.
    """
    step = _Step(plant, task, limits, list(targets)[: len(plant.inputs)])
    if why := step.ends(1 - SIZE, 0.0):
        return Moves(left_out=((STEP, why),))
    said, larger, ahead = list[LeftOut](), SIZE, _OFFSET
    if why := step.ends(1 + SIZE + _OFFSET, _BEYOND):
        ahead, larger = 0.0, 0.0 if (closer := step.ends(1 + SIZE, _BEYOND)) else SIZE
        said += [(LARGER, closer)] * bool(closer) + [(AHEAD, why)]
    back = 0.0 if (why := step.ends(-_OFFSET, _BEHIND)) else _OFFSET
    said += [(BACK, why)] * bool(why)
    turned = step.ends(-(1 + larger + back), _BEHIND)
    said += [(DIRECTION, turned)] * bool(turned)
    return Moves(larger, SIZE, ahead, back, not turned, tuple(said))


@dataclass(frozen=True, slots=True, eq=False)
class VariedLoop:
    """A closed loop whose plant, sensors, actuators and task vary, while its controller stays.

    A varied plant starts at rest with the outputs of the study: its controller had brought it there.
    """

    plant: Plant  # plant of the study
    task: Task  # task of the study
    build: Build  # what a loop does
    controller: Callable[[Float[np.ndarray, " n"]], Controller]  # function of θ that makes the controller
    wears: bool = True  # whether sensors can have a resolution, and actuators backlash
    jitters: bool = False  # whether periods can differ
    moves: Moves = Moves()  # what varies of the step

    def varied(self, *said: LeftOut) -> Varied:
        """Return what varies; `said` is what does not, beside what follows from plant and task."""
        late, waits = latest(self.plant, self.task.measurement_delay) > 0, waits_inside(self.plant)
        # As far as its record leaves it open, dead time varies with an identified plant.
        late = late or sample_of(self.plant) is not None
        missing: dict[LeftOut, bool] = {
            (DELAY, "none is stated; more would act like the lag: see the delay margin"): late or waits,
            ("dead time in the states (poles at 0)", "state it as a delay"): not waits,
            (MOVE, "none is stated"): self.task.max_move is not None,
            (LAG, "the record has that of the actuator in it"): sample_of(self.plant) is None,
            (LOAD, "none acts: no disturbance of the task changes"): self._loaded,
            (JITTER, "a period has one length here"): self.jitters,
            (INSIDE, "prefcal cannot see them: of a plant that is a dataclass each number varies"): not (
                hides_numbers(self.plant)
            ),
        }
        loads = ((name, why) for name, size in _LOADS if (why := self._beyond_load(size)))
        rows = (row for row, there in missing.items() if not there)
        left_out = (*said, *self.moves.left_out, *loads, *rows)
        factors = (*factors_of(self.plant, self.task.measurement_delay), *self._others())
        return Varied(factors, left_out, self.at, self, self.unheld)

    def at(self, values: Values) -> Source:
        """Return the loop with these values."""
        plant = varied_plant(self.plant, values, self._later(values))
        spans = np.array([c.high - c.low for c in plant.inputs])
        play = values.get(PLAY, 0.0) / 2 * np.where(np.isfinite(spans), spans, 0.0)
        grain = values.get(GRAIN, 0.0) * self._step
        return self.build(plant, self.task_of(plant, values), grain, play)

    def _others(self) -> Iterator[Factor]:
        """Yield what varies beside the plant."""
        if self._noisy:
            yield Factor.around(NOISE, "sensor", _WEAR, unit=STATED, possible=NOT_NEGATIVE)
        else:
            (most, told), unit = self._usual_noise, "of the step (standard deviation)"
            yield Factor(NOISE, "sensor", 0.0, 0.0, most, unit, possible=NOT_NEGATIVE, told=told)
        if self.wears:
            yield Factor(GRAIN, "sensor", 0.0, 0.0, _GRAIN, "of the step", possible=NOT_NEGATIVE)
        yield Factor(BIAS, "sensor", 0.0, -_BIAS, _BIAS, "of the step")
        if sample_of(self.plant) is None:  # a record has the actuator in it
            lag = _LAG * self._dominant
            yield Factor(LAG, "actuator", 0.0, 0.0, lag, self.plant.time_unit, possible=NOT_NEGATIVE)
        if self.wears:
            told = "usual, whole gap; inputs count behind it"
            yield Factor(PLAY, "actuator", 0.0, 0.0, _PLAY, "of the range", possible=NOT_NEGATIVE, told=told)
        if self.jitters:
            yield Factor(JITTER, "sensor", 0.0, 0.0, _JITTER, "of the period", possible=(0.0, _MOST))
        if self.task.max_move is not None:
            yield Factor.around(MOVE, "actuator", SIZE, unit=STATED, possible=(LEAST, np.inf))
        if self._loaded:
            more = 0.0 if self._beyond_load(1 + SIZE) else SIZE
            load = Factor.around(LOAD, "task", (-SIZE, more), unit=STATED, possible=NOT_NEGATIVE)
            yield replace(load, told=f"usual, {self._acting}")
            if not self._beyond_load(-1.0):
                yield Factor(TURN, "task", 1.0, -1.0, 1.0, ends=True)
        yield from self._steps() if self.moves.names else ()

    def _steps(self) -> Iterator[Factor]:
        """Yield what varies of the step."""
        moves, (starts, targets, turned) = self.moves, self._places
        size = Factor.around(REFERENCE, "task", (-moves.smaller, moves.larger), unit=STATED)
        steps = (
            replace(size, possible=(LEAST, np.inf), told=targets),
            Factor(SHIFT, "task", 0.0, -moves.back, moves.ahead, "of the step", told=starts),
            Factor(DIRECTION, "task", 1.0, -1.0, 1.0, ends=True, told=turned),
        )
        yield from (factor for factor in steps if factor.name in moves.names)

    @property
    def _places(self) -> tuple[str, str, str]:
        """Return in words where the first output starts and is sent by start, size and direction, each alone.

        Each is said alone, since people may leave out the others.
        """
        k, moves = tracked_of(self.task)[0], self.moves
        y, start = self.plant.outputs[k], float(self.start[k])
        first, last = (self.task.reference(t)[k] - start for t in (0.0, self.task.horizon))

        def between(*ends: float) -> str:
            return f"{_in(min(ends), replace(y, unit=''))} to {_in(max(ends), y)}"

        times, least = _times(self.task.y_ref, self.task), 1e-6 * abs(last)
        moved = [t for t in times if abs(self.task.reference(t)[k] - start) > least]
        when = self._since(min(moved, default=0.0), self.task.y_ref)
        starts = between(*(start + shift * first for shift in (-moves.back, moves.ahead)))
        targets = between(*(start + size * last for size in (1 - moves.smaller, 1 + moves.larger)))
        return (
            f"usual, {y.name} from {starts}, and the target moves along",
            f"usual, step of {y.name} by {_in(last, y)} {when}; alone: targets from {targets}",
            f"usual, alone: target of {y.name} at {_in(start - last, y)}",
        )

    @property
    def _acting(self) -> str:
        """Return in words which loads act, how large each is at most, and from when on."""
        times, said = _times(self.task.d, self.task), list[str]()
        delays = np.broadcast_to(getattr(self.plant, "input_delay", 0.0), len(self.plant.inputs)).tolist()
        late = {c.name for c, delay in zip(self.plant.inputs, delays, strict=True) if delay}
        for c, load in zip(self.plant.disturbances, self._loads.T, strict=True):
            if load.any():
                name, size = c.name.removeprefix(ADDED), _in(load[np.abs(load).argmax()], c)
                behind = ", which its dead time does not delay," if name in late else ""
                what = f"load of {size} on {name}{behind}" if name != c.name else f"{name} by {size}"
                said.append(f"{what} {self._since(times[int(load.nonzero()[0][0])], self.task.d)}")
        return ", ".join(said)

    def _since(self, t: float, signal: Signal | None) -> str:
        """Return in words from which sample on a signal changes; a function of time is only looked at."""
        about = "about " * (callable(signal) and not isinstance(signal, StepSignal))
        if not about:
            t = acts_at(t, np.arange(0.0, self.task.horizon, self.task.T_s))
        return f"at {about}{_in(t, Channel('', self.plant.time_unit))}" if t else "at the start"

    def _later(self, values: Values) -> float:
        """Return the factor of all dead times."""
        late = values.get(DELAY)
        return 1.0 if late is None else late / latest(self.plant, self.task.measurement_delay)

    @property
    def _noisy(self) -> bool:
        return self.task.noise is not None and bool(np.any(self.task.noise))

    @property
    def _usual_noise(self) -> tuple[float, str]:
        """Return the largest noise of sensors without any, as a share of the step, and its reason."""
        sample, step = sample_of(self.plant), self._step.max(initial=0.0)
        found = float(f"{sample.noise / step:.2g}") if sample and step else 0.0
        if sample is None or found <= _NOISE:
            return _NOISE, ""
        unit = self.plant.outputs[0].unit
        return found, f"{IDENTIFIED}the noise of {sample.record}, {sample.noise:.2g} {unit}".rstrip()

    @property
    def _loads(self) -> Float[np.ndarray, "K n_d"]:
        """Return how far the disturbances are from their start, a row for each time when they may change."""
        rows = np.array([self.task.disturbance(t) for t in _times(self.task.d, self.task)])
        return np.asarray(rows - rows[0])

    @property
    def _loaded(self) -> bool:
        return bool(self._loads.any())

    def _beyond_load(self, size: float) -> str:
        """Return which disturbance would be beyond its limit with `size` times the load; "" if none."""
        start, loads = self.task.disturbance(0.0), self._loads
        for c, first, load in zip(self.plant.disturbances, start, loads.T, strict=True):
            ends = (float(first + part * load[np.abs(load).argmax()]) for part in (1.0, size))
            stated, wanted = ((_beyond(c, end), end) for end in ends)
            if wanted[0] and not stated[0]:
                return f"{c.name} would go to {_in(wanted[1], c)}, beyond its limit of {wanted[0]}"
        return ""

    @property
    def _dominant(self) -> float:
        """Return the time constant that a lag of the actuators is measured by, in the plant's unit of time.

        It is the slowest one that is not longer than the experiment, and a twentieth of that at most: slower
        parts act as integrators meanwhile. A tenth of the hours of a wall would stop any heating that acts
        within minutes. Of a plant that is not linear, it is the shorter one of those at start and target.
        """
        tasks = self.task, at_target(self.plant, self.task)
        return min(self._dominant_at(task) for task in tasks if task is not None)

    def _dominant_at(self, task: Task) -> float:
        own = self.plant.plant if isinstance(self.plant, Disturbed) else self.plant
        point = task.x0, task.u0, task.disturbance(0.0)
        try:
            J = local_system(own if isinstance(own, LinearPlant) else self.plant, *point)
        except PlantError:  # such as the outflow of an empty tank, whose derivative is infinite
            return task.horizon / 20
        poles = np.linalg.eigvals(J.A)
        if J.dt:
            poles = np.log(poles[np.abs(poles) > AT_ZERO].astype(complex)) / J.dt
        rates, horizon = np.abs(poles), task.horizon
        slowest = 1 / rates[rates * horizon >= 1.0].min(initial=np.inf)
        return float(min(slowest or np.inf, horizon / 20))

    @property
    def start(self) -> Y:
        """Outputs at the start, shape (n_y,)."""
        return np.asarray(self.plant.g(self.task.x0, self.task.u0, self.task.disturbance(0.0)))

    @property
    def _step(self) -> Y:
        """Largest change of each output's reference, from the start, shape (n_y,); 0 for none."""
        times = _times(self.task.y_ref, self.task)
        changes = np.array([np.abs(self.task.reference(t) - self.start) for t in times])
        return np.asarray(np.nan_to_num(changes).max(axis=0))

    def task_of(self, plant: Plant, values: Values) -> Task:
        """Return the task of a varied plant, which starts at rest, with other noise, rate, load and step."""
        task, d, size = self.task, self.task.d, values.get(LOAD, 1.0) * values.get(TURN, 1.0)
        if self._noisy:
            noise = values.get(NOISE, 1.0) * np.asarray(task.noise)
        else:
            noise = values.get(NOISE, 0.0) * self._step
        if size != 1.0 and callable(d):
            d = _scaled(d, task.disturbance(0.0), size)
        x0, u0 = self._rest(plant, values.get(SHIFT, 0.0))
        y_ref: Signal = task.y_ref
        if self.moves.names:
            y_ref = y_ref if callable(y_ref) else StepSignal(y_ref)
            size = values.get(REFERENCE, 1.0) * values.get(DIRECTION, 1.0)
            y_ref = _scaled(y_ref, self.start, size, plant.g(x0, u0, task.disturbance(0.0)) - self.start)
        moves = None if task.max_move is None else task.max_move * values.get(MOVE, 1.0)
        if (later := self._later(values)) != 1.0:
            task = replace(task, measurement_delay=(later * np.asarray(task.measurement_delay)).tolist())
        if self._noisy or noise.any():
            task = replace(task, noise=noise)
        if BIAS in values:
            own = 0.0 if task.bias is None else task.bias
            task = replace(task, bias=own + values[BIAS] * self._step)
        if hasattr(task.unsafe, "around"):  # outputs of another plant follow from its states in another way
            unsafe = task.unsafe.around(plant)
            task = replace(task, unsafe=unsafe, vectorized=unsafe.vectorized)
        jitter, lag = max(task.jitter, values.get(JITTER, 0.0)), task.lag + values.get(LAG, 0.0)
        return replace(task, x0=x0, u0=u0, y_ref=y_ref, d=d, max_move=moves, jitter=jitter, lag=lag)

    def unheld(self, values: Values) -> Unheld | None:
        """Return where no input within its range holds the plant with these values; None if one does.

        A place counts only if the nominal plant can be held there, and if a steady state is known.
        """
        plant = varied_plant(self.plant, values, self._later(values))
        task = self.task_of(plant, values)
        for place in PLACES:
            found = self._input_at(place, plant, task)
            if found is None or not (lost := _outside(plant, found)):
                continue
            nominal = self._input_at(place, self.plant, self.task)
            if nominal is not None and not _outside(self.plant, nominal):
                return Unheld(place, plant.inputs[lost[0]].name, float(found[lost[0]]))
        return None

    def _input_at(self, place: str, plant: Plant, task: Task) -> U | None:
        """Return the input at which a plant rests at a place of its task; None if that is not known.

        A target is reached within its accepted band: so of those there, one within the range counts.
        """
        if place == PLACES[0]:
            return np.asarray(task.u0)
        if not all(_mostly_rests(signal, task) for signal in (task.y_ref, task.d)):
            return None  # what moves all the time has no place to rest at
        if len(tracked_of(task)) < len(plant.inputs):
            return None  # of many inputs that hold it there, only one is found
        near = at_target(self.plant, self.task) or task
        d, chosen = task.disturbance(0.0 if place == PLACES[1] else task.horizon), list(tracked_of(task))
        chosen = chosen[: len(plant.inputs)]
        aims = task.reference(task.horizon)[chosen]
        width = np.array([(task.bands or {}).get(k, 0.0) for k in chosen])
        ends = (aims, aims - width, aims + width) if width.any() else (aims,)
        rests = [rest(plant, near.x0, near.u0, d, chosen, each.tolist()) for each in ends]
        inputs = [found[1] for found in rests if found is not None]
        return min(inputs, key=lambda u: len(_outside(plant, u)), default=None)

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


def _outside(plant: Plant, u: U) -> list[int]:
    """Return the indices of inputs that are outside their range, but for rounding."""
    spans = [1e-6 * (c.high - c.low if np.isfinite(c.high - c.low) else 1.0) for c in plant.inputs]
    pairs = enumerate(zip(plant.inputs, u, spans, strict=True))
    return [k for k, (c, v, near) in pairs if not c.low - near <= v <= c.high + near]


def _times(signal: Signal | None, task: Task) -> list[float]:
    """Return the times at which a signal may change: its steps, or many of another function of time."""
    if isinstance(signal, StepSignal):
        return [0.0, *(t for t, _ in signal.steps)]
    return [*map(float, np.linspace(0.0, task.horizon, _SAMPLES if callable(signal) else 1))]


def _mostly_rests(signal: Signal | None, task: Task) -> bool:
    """Return whether a signal, also a function of time, changes in a few moments only and rests between."""
    if isinstance(signal, StepSignal) or not callable(signal):
        return True
    values = np.array([signal(t) for t in _times(signal, task)]).reshape(_SAMPLES, -1)
    return bool(np.any(np.diff(values, axis=0) != 0, axis=1).mean() < _MOVING)


def _scaled(
    signal: Callable[[float], Any], around: np.ndarray, size: float, shift: np.ndarray | float = 0.0
) -> Callable[[float], np.ndarray]:
    """Return a signal whose distance from some values is multiplied by `size`, and that is shifted."""
    moved = partial(_move_values, around, size, shift)
    if isinstance(signal, StepSignal):
        return StepSignal(moved(signal.start), tuple((t, moved(v)) for t, v in signal.steps))
    return lambda t: moved(signal(t))


def _move_values(around: np.ndarray, size: float, shift: np.ndarray | float, values: Any) -> np.ndarray:
    return np.asarray(around + size * (np.asarray(values) - around) + shift)


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
