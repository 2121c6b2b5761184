"""What varies of a plant, from run to run, and a scenario with what of it can vary."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from math import ceil, copysign
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_number
from prefcal_env.controllers.margins import MarginKPIs, Margins
from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.plant_env import dead_times
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y
from prefcal_env.plants.plant import Disturbed, Plant
from prefcal_env.plants.systems import DEAD_TIMES, LinearPlant, scaled_times
from prefcal_env.sources.source import Maneuvers, Source, WithKPIs, function_of
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.cases.loops.plants import CompiledPlant, Linear

# --- One thing that varies from run to run of a verification.

Kind = Literal["parameter", "dead time", "sensor", "actuator", "task"]
Values = Mapping[str, float]
"""Values of factors by name, in their units; those left out are nominal."""
Ranges = Mapping[str, float | Sequence[float]]
"""Relative changes by name or kind of factor: one number for both directions, or two.

By its name, a factor changes as given; by its kind, its usual range grows as the kind's usual change does.
"""
USUAL: Mapping[Kind, float] = {
    "parameter": 0.1,
    "dead time": 0.2,
    "sensor": 1.0,
    "actuator": 0.1,
    "task": 0.2,
}
"""Usual relative change of each kind."""
ANY, NOT_NEGATIVE = (-np.inf, np.inf), (0.0, np.inf)
"""Possible values of a factor."""


@dataclass(frozen=True, slots=True)
class Factor:
    """A quantity that varies, uniformly from `low` to `high`, in `unit`.

    Args:
        name: Name for people, such as "gain of valve".
        kind: What it belongs to.
        nominal: Value of the study.
        low: Lowest value.
        high: Highest value.
        unit: Unit, or what it is a share of; "" also for a factor by which something is multiplied.
        ends: Whether it only has its lowest and its highest value, as a direction does.
        possible: Smallest and largest value that there can be.
        step: Distance of its values; 0 for any.
        stated: Whether somebody stated its range, which is the usual one otherwise.
    """

    name: str
    kind: Kind
    nominal: float
    low: float
    high: float
    unit: str = ""
    ends: bool = False
    possible: tuple[float, float] = ANY
    step: float = 0.0
    stated: bool = False

    @classmethod
    def around(
        cls,
        name: str,
        kind: Kind,
        change: float | Sequence[float],
        nominal: float = 1.0,
        unit: str = "",
        possible: tuple[float, float] = ANY,
    ) -> "Factor":
        """Return the factor that changes by a share of its nominal value, or, if that is 0, by so much."""
        (down, up), size = _both(change), abs(nominal) or 1.0
        low, high = nominal + down * size, nominal + up * size
        return cls(name, kind, nominal, low, high, unit, possible=possible)

    def value(self, share: float) -> float:
        """Return the value at a share of the way from the lowest to the highest, 0 to 1."""
        if self.ends:
            return self.low if share < 0.5 else self.high
        if self.step:
            count = round((self.high - self.low) / self.step) + 1
            return self.low + self.step * min(int(share * count), count - 1)
        return self.low + share * (self.high - self.low)

    def stepped(self, step: float) -> "Factor":
        """Return the factor whose values are `step` apart: each of its ends moves away by less than that."""
        sides = (end - self.nominal for end in (self.low, self.high))
        low, high = (copysign(step * ceil(abs(side) / step - 1e-9), side) for side in sides)
        return replace(self, low=self.nominal + low, high=self.nominal + high, step=step)


def within(factors: Iterable[Factor], ranges: Ranges) -> tuple[Factor, ...]:
    """Return the factors that vary, with these relative changes in place of the usual ones.

    A name comes before its kind, and a change of 0 leaves a factor out.

    Raises:
        SettingsError: If a name is unknown, or a change is no number, has no direction or is impossible.
    """
    found = list(factors)
    known = {*(factor.name for factor in found), *get_args(Kind)}
    for name, change in ranges.items():
        if name not in known:
            raise SettingsError(
                f"nothing that varies is called {name!r}.{did_you_mean(name, known)} Expected one of "
                f"{sorted(known)}"
            )
        both = _both(change)
        if len(both) != 2 or not all(is_number(e) and np.isfinite(e) for e in both) or both[0] > both[1]:
            raise SettingsError(f"the range of {name!r} must be a number or two, low first, got {change!r}")
    changed = (_with_ranges(f, ranges) for f in found)
    return tuple(f for f in changed if f.low != f.nominal or f.high != f.nominal)


def _both(change: float | Sequence[float]) -> list[float]:
    """Return the change downwards and upwards."""
    return [-change, change] if isinstance(change, int | float) else list(change)


def _with_ranges(factor: Factor, ranges: Ranges) -> Factor:
    """Return a factor with another range, if one is given for its name or its kind."""
    named = factor.name in ranges
    change = ranges.get(factor.name, ranges.get(factor.kind))
    if change is None or (factor.ends and any(_both(change)) and not named):
        return factor
    if factor.ends and any(_both(change)):
        values = f"{factor.low:g} or {factor.high:g}"
        raise SettingsError(
            f"{factor.name!r} is {values}: only 0, which leaves it out, changes that, got {change}"
        )
    wide = Factor.around(factor.name, factor.kind, change, factor.nominal)
    low, high = wide.low, wide.high
    if not named:
        sides = factor.nominal - factor.low, factor.high - factor.nominal
        low, high = (factor.nominal + c / USUAL[factor.kind] * sides[c > 0] for c in _both(change))
    least, most = factor.possible
    if low < least or high > most:
        raise SettingsError(
            f"{factor.name!r} would be {low:.4g} to {high:.4g} {factor.unit}".rstrip()
            + f", but only {least:.4g} to {most:.4g} is possible: got a change of {change}"
        )
    changed = replace(factor, low=low, high=high, stated=True)
    return changed.stepped(factor.step) if factor.step else changed


def drawn(factors: Sequence[Factor], seed: int, k: int) -> dict[str, float]:
    """Return the values of run k by name: independent of all other runs and of their number."""
    shares: Float[np.ndarray, " n"] = np.random.default_rng([seed, k]).random(len(factors))
    return {f.name: f.value(share) for f, share in zip(factors, shares.tolist(), strict=True)}


# --- The steady state of a varied plant: it starts where its controller had brought it.

_STEPS, _EXACT, _RESTS, _NEAR = 30, 1e-13, 1e-9, 1e-5
"""Most steps of Newton's method; what counts as rest at once, as its last step, and as rest at all."""


def rest(
    plant: Plant, x: X, u: U, d: Float[np.ndarray, " n_d"], outputs: Sequence[int], aims: Sequence[float]
) -> tuple[X, U] | None:
    """Return a steady state at which some outputs have given values, or None.

    It is found by Newton's method from (x, u), with the smallest step if several would do.

    Args:
        plant: Plant.
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


def at_rest(plant: Plant, x: X, u: U, d: Float[np.ndarray, " n_d"]) -> bool:
    """Return whether a plant hardly moves at a point, in its unit of time."""
    return bool(np.abs(plant.f(x, u, d)).max(initial=0.0) <= _NEAR * (1 + np.abs(x).max(initial=0.0)))


# --- What varies of a plant: its parameters, dead time and the ranges of its inputs.

CHANGE, SIZE, NARROWER = USUAL["parameter"], USUAL["dead time"], USUAL["actuator"]
"""Relative changes: of parameters; of dead time, loads and references; of the ranges of inputs."""
LEAST = 0.01
"""Smallest share of its nominal value that what cannot be 0 can have."""
SPEED, DELAY = "all time constants", "dead time"
_AT_ZERO = 1e-3  # magnitude below which a discrete pole is one at 0
_NOT_PARAMETERS = ("max_step", "dead_time")


def latest(plant: Plant, measuring: float | Sequence[float] = 0.0) -> float:
    """Return the longest dead time from an input to a measured output, whose sensors add `measuring`."""
    return float((dead_times(plant) + np.reshape(measuring, (-1, 1))).max())


def waits_inside(plant: Plant) -> bool:
    """Return whether states of a discrete plant only hand on what came before: poles at 0."""
    own = plant.plant if isinstance(plant, Disturbed) else plant
    if not (isinstance(own, LinearPlant) and own.sample_time):
        return False
    return bool((np.abs(np.linalg.eigvals(own.system.A)) < _AT_ZERO).any())


def factors_of(plant: Plant, measuring: float | Sequence[float] = 0.0) -> Iterator[Factor]:
    """Yield what varies of a plant: parameters, dead time, and the ranges of its inputs.

    Parameters are the numbers of one that is a dataclass, as `CSTR`. Of matrices they are the time
    constant of each state and the gain of each input, of other equations all time constants together.
    So are those of states without names: a row of a transfer function's matrices is no parameter.
    Dead time of inputs, outputs, entries and sensors (`measuring`) varies together, by the same share:
    the factor is the longest one from an input to an output.
    """
    own = plant.plant if isinstance(plant, Disturbed) else plant
    matrices, numbers = _matrices(own), dict(_numbers(own))
    if matrices is not None:
        for state, a, b in zip(own.states, *matrices, strict=False):
            # A row such as ẋ = v says what a state is: it has no parameter.
            if b.any() or not np.isin(np.abs(a), (0.0, 1.0)).all():
                yield _parameter(_constant(state))
    elif numbers:
        yield from (_parameter(_words(n), value) for n, value in numbers.items())
    elif own.states and not getattr(own, "sample_time", 0.0):
        yield _parameter(SPEED)
    if matrices is not None or not numbers:
        yield from (_parameter(_gain(c)) for c in own.inputs)
    if late := latest(own, measuring):
        found = Factor.around(DELAY, "dead time", SIZE, late, own.time_unit, NOT_NEGATIVE)
        step = getattr(own, "sample_time", 0.0)  # between its samples, a discrete plant sees nothing
        yield found.stepped(step) if step else found
    for c in plant.inputs:
        if np.isfinite(c.high - c.low):
            yield Factor(_range(c), "actuator", 1.0, 1 - NARROWER, 1.0, possible=(LEAST, 1.0))


def _parameter(name: str, value: float = 1.0) -> Factor:
    """Return a parameter of a plant, which is above 0 and stays so."""
    return Factor.around(name, "parameter", CHANGE, value, possible=(LEAST * value, np.inf))


def varied_plant(plant: Plant, values: Values, later: float = 1.0) -> Plant:
    """Return a plant with other parameters and ranges of its inputs, and `later` times its dead time."""
    inputs = tuple(_narrowed(c, values.get(_range(c), 1.0)) for c in plant.inputs)
    if isinstance(plant, Disturbed):
        return plant.around(_changed(plant.plant, values, later), inputs)
    made = _changed(plant, values, later)
    return replace(made, inputs=inputs) if isinstance(made, CompiledPlant) else Disturbed(made, inputs=inputs)


def _changed(plant: Plant, values: Values, later: float) -> Plant:
    """Return a plant with other parameters, time constants, gains and dead time."""
    gains = np.array([values.get(_gain(c), 1.0) for c in plant.inputs])
    rates = np.array([1 / values.get(_constant(c), 1.0) for c in plant.states])
    speed = 1 / values.get(SPEED, 1.0)
    if isinstance(plant, CompiledPlant):
        if isinstance(plant.parameters, Linear):
            A, B, E = (np.array(M, dtype=float) * rates[:, None] for M in plant.parameters)
            made = Linear(*(tuple(map(tuple, M.tolist())) for M in (A, B * gains, E)))
            plant = replace(plant, parameters=made)
        named: CompiledPlant = _with_numbers(plant, values)
        return replace(named, dead_time=later * plant.dead_time)
    if isinstance(plant, LinearPlant):
        return plant.scaled(speed * rates, gains, later)
    if dict(_numbers(plant)):
        plant = _with_numbers(plant, values)
    if (gains == 1).all() and speed == later == 1:
        return plant
    return Scaled(plant, speed, gains, later)


@dataclass(frozen=True, eq=False)
class Scaled:
    """A plant that is slower or faster by one factor, and whose inputs act more or less, or later."""

    plant: Plant
    speed: float  # factor of all rates
    gains: Float[np.ndarray, " n_u"]  # factor of each input, shape (n_u,)
    later: float  # factor of all dead times

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("plant", "later"):
            raise AttributeError(name)
        found = getattr(self.plant, name)
        return scaled_times(found, self.later) if name in DEAD_TIMES else found

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
    """Return A and B of a plant whose states have names; a discrete one has no time constants."""
    if isinstance(plant, LinearPlant) and plant.has_named_states:
        rows = 0 if plant.sample_time else len(plant.states)
        return plant.system.A[:rows], plant.system.B[:rows]
    if isinstance(plant, CompiledPlant) and isinstance(plant.parameters, Linear):
        A, B, E = (np.array(M, dtype=float) for M in plant.parameters)
        return A, np.column_stack([B, E])
    return None


def _narrowed(c: Channel, share: float) -> Channel:
    """Return an input that has only a share of its range, around its middle."""
    if share == 1.0:
        return c
    middle, half = (c.high + c.low) / 2, share * (c.high - c.low) / 2
    return replace(c, low=middle - half, high=middle + half)


def _range(c: Channel) -> str:
    return f"range of {c.name}"


def _constant(state: Channel) -> str:
    return f"time constant of {state.name}"


def _gain(c: Channel) -> str:
    return f"gain of {c.name}"


def _words(name: str) -> str:
    return name.replace("_", " ")


def _parts(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass or named tuple that may be parameters; none of anything else."""
    names = [f.name for f in fields(value)] if is_dataclass(value) else getattr(value, "_fields", ())
    return {name: getattr(value, name) for name in names if name not in _NOT_PARAMETERS}


def _numbers(value: Any) -> Iterator[tuple[str, float]]:
    """Yield the positive numbers of a dataclass or named tuple, also of those in it, by name."""
    for name, each in _parts(value).items():
        if isinstance(each, float) and 0 < each < np.inf:
            yield name, each
        else:
            yield from _numbers(each)


def _with_numbers(value: Any, values: Values) -> Any:
    """Return a dataclass or named tuple with other numbers."""
    changes: dict[str, Any] = {}
    for name, each in _parts(value).items():
        if isinstance(each, float) and _words(name) in values:
            changes[name] = values[_words(name)]
        elif _parts(each):
            changes[name] = _with_numbers(each, values)
    made: Any = value._replace(**changes) if hasattr(value, "_replace") else replace(value, **changes)
    return made


# --- A scenario with what of it can vary.


def unknown_plant(theta: Float[np.ndarray, " n"]) -> str:
    """Return why a θ of a run whose plant nobody knows has no margins."""
    return "no margins: the plant is not known as equations, so it cannot be linearized"


@dataclass(frozen=True, slots=True)
class Subject:
    """What can vary, and how a run with other values is made."""

    factors: tuple[Factor, ...]  # what can vary
    left_out: tuple[str, ...]  # what cannot, a sentence each
    # function of values that returns the source with them; the controller stays as
    # designed
    at: Callable[[Values], Source]
    # function of a physical θ, shape (n,), that returns its margins where the nominal
    # experiment starts, or why there are none
    margins: Callable[[Float[np.ndarray, " n"]], Margins | str] = unknown_plant

    def measured_as(self, source: WithKPIs) -> "Subject":
        """Return the same whose runs have the KPIs of `source`."""
        return replace(self, at=partial(_measured, self.at, source))


def of_maneuvers(source: Maneuvers, parts: dict[str, Subject]) -> Subject:
    """Return what varies in all maneuvers together; margins are those of the first one.

    A value that differs from its nominal one does so by the same share in each maneuver.
    """
    first = {f.name: f for part in reversed(parts.values()) for f in part.factors}
    said = dict.fromkeys(text for part in parts.values() for text in part.left_out)
    at = partial(_maneuvers, source, parts, first)
    return Subject(tuple(first.values()), tuple(said), at, next(iter(parts.values())).margins)


def _measured(at: Callable[[Values], Source], source: WithKPIs, values: Values) -> Source:
    made, kpis = at(values), source.kpis
    loop = function_of(made)
    if isinstance(kpis, MarginKPIs) and isinstance(loop, ClosedLoop):
        # Of the varied plant, but of the controller itself: a law that sticks has no margins.
        kpis = MarginKPIs(ClosedLoop(loop.env, kpis.loop.controller))
    return WithKPIs(made, kpis)


def _maneuvers(
    source: Maneuvers, parts: dict[str, Subject], first: dict[str, Factor], values: Values
) -> Maneuvers:
    made = {name: part.at(_own(part, first, values)) for name, part in parts.items()}
    return Maneuvers(made, higher_is_better=source.higher_is_better, targets=source.targets)


def _own(part: Subject, first: dict[str, Factor], values: Values) -> dict[str, float]:
    """Return the values of one maneuver, given those for the nominal values of the first one."""
    found = {}
    for factor in part.factors:
        if factor.name in values:
            nominal = first[factor.name].nominal
            share = factor.nominal / nominal if nominal else 1.0
            found[factor.name] = share * values[factor.name]
    return found
