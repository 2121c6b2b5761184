"""What varies of a plant, from run to run: its parameters, dead time and the ranges of its inputs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y
from prefcal_env.plants.plant import Disturbed, Plant
from prefcal_env.plants.systems import DEAD_TIMES, Ensemble, LinearPlant, scale_times
from prefcal_env.sources.varied import CHANGE, LEAST, NARROWER, NOT_NEGATIVE, SIZE, Factor, Values

from .plant_env import dead_times, tracked_of
from .task import Task

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
        name, told, ends = _identified(sample), f"identified: {sample.told}", (1.0, float(count))
        yield Factor(name, "parameter", sample.best + 1.0, *ends, f"of {count}", False, ends, 1.0, told=told)
    else:
        yield from _parameters(own, measuring)
    for c in plant.inputs:
        if np.isfinite(c.high - c.low):
            yield Factor(_range(c), "actuator", 1.0, 1 - NARROWER, 1.0, possible=(LEAST, 1.0))


def sample_of(plant: Plant) -> Ensemble | None:
    """Return the plants of which an identified plant is one; None if it was not identified."""
    own = plant.plant if isinstance(plant, Disturbed) else plant
    return getattr(own, "sample", None)


def _identified(sample: Ensemble) -> str:
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
        yield from (_parameter(_gain(c)) for c in own.inputs)
    if late := latest(own, measuring):
        found = Factor.around(DELAY, "dead time", SIZE, late, own.time_unit, NOT_NEGATIVE)
        step = getattr(own, "sample_time", 0.0)  # between its samples, a discrete plant sees nothing
        yield found.stepped(step) if step else found


def _parameter(name: str, value: float = 1.0, unit: str = "") -> Factor:
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
        return plant.around(_changed(plant.plant, values, later), inputs)
    return Disturbed(_changed(plant, values, later), inputs=inputs)


def _changed(plant: Plant, values: Values, later: float) -> Plant:
    """Return a plant with other parameters, time constants, gains and dead time."""
    if isinstance(plant, LinearPlant) and (sample := sample_of(plant)):
        return plant.another(int(values.get(_identified(sample), sample.best + 1.0)) - 1)
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
    return ScaledPlant(named, speed, gains, later)


@dataclass(frozen=True, eq=False)
class ScaledPlant:
    """A plant that is slower or faster by one factor, and whose inputs act more or less, or later."""

    plant: Plant
    speed: float  # factor of all rates
    gains: Float[np.ndarray, " n_u"]  # factor of each input, shape (n_u,)
    later: float  # factor of all dead times

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("plant", "later"):
            raise AttributeError(name)
        found = getattr(self.plant, name)
        return scale_times(found, self.later) if name in DEAD_TIMES else found

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return self.speed * self.plant.f(x, self.gains * u, d)

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs."""
        return self.plant.g(x, self.gains * u, d)

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input adds to the outputs, if the plant can tell."""
        found: np.ndarray = self.plant.entries(x, self.gains * u, d)  # type: ignore[attr-defined]
        return found

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives."""
        J = self.plant.jacobians(x, self.gains * u, d)
        return Jacobians(self.speed * J.A, self.speed * J.B * self.gains, J.C, J.D * self.gains)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`."""
        return self.plant.hold(x, self.gains * u, d, np.asarray(times) * self.speed)


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
