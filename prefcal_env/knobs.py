"""Knobs, the space they span between unit cube and physical units, its constraints, and its changes."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import floor, isfinite, log, log1p, log10, ulp
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.arrays import is_number

from .errors import KnobError
from .units import same


def theta_key(theta: Float[np.ndarray, " n"] | Sequence[float]) -> bytes:
    """Return the same bytes for equal θ, physical, shape (n,), whatever the sign of a zero."""
    return theta_keys(np.asarray(theta, dtype=float)[None])[0]


def theta_keys(thetas: Float[np.ndarray, "m n"]) -> list[bytes]:
    """Return the key of each of m physical θ, shape (m, n), as `theta_key` does of one."""
    return [theta.tobytes() for theta in thetas + 0.0]  # -0.0 + 0.0 is 0.0


# --- A knob: one tunable number, its resolution, and its place in the unit interval.

KnobScale = Literal["linear", "log10"]

_DECODED = 1e-12  # error of decoding a proposed value, as a share of the knob's range
_SHARE = 100  # the default step is at most the range divided by this
_FINEST = 1e-13  # smallest step relative to the values: below it, doubles cannot be rounded
_DIGITS = 15  # significant digits of a double that survive a multiplication
_FEWEST = 2**13  # fewest floats in a range: about a hundred that differ by more than rounding
_ROUNDING = 1e-14  # error of decoding, relative to a linear knob's bounds or a log10 knob's value


@dataclass(frozen=True, slots=True)
class Knob:
    """A tunable number between `low` and `high`, both inclusive and in `unit`.

    Args:
        name: Name of the knob, as shown to people.
        low: Smallest value.
        high: Largest value.
        unit: Unit of both bounds.
        scale: "linear" if differences count, "log10" if ratios count; then both bounds have one sign.
        integer: Whether only whole numbers are valid.
        step: Resolution, in `unit`: the smallest change that a person can dial in or notice. On a
            log10 scale it is relative: 0.02 is 2 %. Proposed values are multiples of it. None
            picks a round number between 1/250 and 1/100 of the range, or 1 for an integer knob; 0
            proposes any value.
        about: One sentence that tells people what the knob does. It is ignored when knobs are
            compared, and is not saved in study files.

    Raises:
        KnobError: If the bounds are reversed, equal or infinite, lie so close that hardly a number
            fits between them, or have an infinite difference; if the range of a log10 knob holds 0,
            an integer knob has bounds that are not integers, `integer` is neither True nor False, the
            name is empty, the unit is not text, the scale is unknown, or the step is negative, wider
            than the range, or a fraction for an integer knob.
    """

    name: str
    low: float
    high: float
    unit: str = ""
    scale: KnobScale = "linear"
    integer: bool = False
    step: float | None = None
    about: str = field(default="", compare=False, kw_only=True)
    resolution: float = field(init=False, default=0.0, repr=False, compare=False)
    """Step in use, in `unit` (relative on a log10 scale); 0 if any value may be proposed."""

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.strip()):
            raise KnobError(f"a knob needs a name, got {self.name!r}")
        if problem := _problem(self):
            raise KnobError(f"knob {self.name!r}: {problem}")
        step = self.step
        if step is None:
            step = 1.0 if self.integer else default_step(self.low, self.high, self.scale)
        object.__setattr__(self, "resolution", float(step))

    @property
    def _sign(self) -> float:
        """Sign of all values of a log10 knob."""
        return 1.0 if self.low > 0 else -1.0

    def round(self, value: float) -> float:
        """Return the valid proposal nearest to `value`, both in `unit`.

        Valid proposals are the multiples of the resolution (on a log10 scale `low` times a power
        of 1 + step, rounded to a few digits) and the two ends of the range.
        """
        step = self.resolution
        if step == 0:
            return value
        if self.scale == "log10" and not self.integer:
            # log1p, since 1 + step has few digits of a small step left.
            count = floor(log(value / self.low) / log1p(step) + 0.5)
            digits = max(2, 2 - floor(log10(step)))  # those that separate neighbors, plus two
            near = float(f"{self.low * (1 + step) ** count:.{digits}g}")
        else:
            # 3 · 0.1 is 0.30000000000000004: cut, it is the number that a person would type.
            near = float(f"{floor(value / step + 0.5) * step:.{_DIGITS}g}")
        near = min(max(near, self.low), self.high)
        for end in (self.low, self.high):  # values, too, though they need not be multiples of the step
            near = end if abs(end - value) < abs(near - value) else near
        return near

    def round_within(self, value: float, part: tuple[float, float]) -> float:
        """Return `value` rounded by `round` and kept inside a part (low, high) of the range."""
        low, high = part
        return value if value in part else float(min(max(self.round(value), low), high))

    def exact(self, value: float, part: tuple[float, float]) -> float:
        """Return `value`, or the border of `part`, (low, high), if they differ only by rounding."""
        for border in part:
            size = abs(border) if self.scale == "log10" else max(abs(self.low), abs(self.high))
            # A round number that near is where `decode` moves the border itself.
            if abs(value - border) <= max(_ROUNDING * size, _DECODED * (self.high - self.low)):
                return border
        return value

    def steps(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return how many steps `values`, in `unit`, lie from 0 (log10: from `low`), shape (m,).

        Raises:
            KnobError: If the knob has no step.
        """
        step = self.resolution
        if step == 0:
            raise KnobError(f"knob {self.name!r} has no step to measure differences by")
        if self.scale == "log10" and not self.integer:
            return np.asarray(self._sign * np.log(values / self.low) / np.log1p(step))
        return np.asarray(values / step)

    def choices(self, low: float, high: float) -> Float[np.ndarray, " m"]:
        """Return the values, in `unit`, that are proposed in this part of the range, increasing, (m,).

        Raises:
            KnobError: If the knob has no step, and the part is not one value.
        """
        if low == high:
            return np.array([low])
        first, last = self.steps(np.array([low, high]))
        inside = np.arange(np.ceil(first), np.floor(last) + 1)
        if self.scale == "log10" and not self.integer:
            values = self.low * (1 + self.resolution) ** (self._sign * inside)
        else:
            values = inside * self.resolution
        values = np.array([low, *(self.round(float(v)) for v in values), high])
        values = np.clip(values, low, high)
        counts, kept = self.steps(values).tolist(), [0]
        for index, count in enumerate(counts):
            # The ends are proposed too, unless a neighbor is almost equal.
            if count - counts[kept[-1]] > 1 - 1e-6:
                kept.append(index)
        return np.asarray(values[kept])

    def decode(self, z: float) -> float:
        """Return the physical value, in `unit`, at `z` in [0, 1]; integers round half up."""
        if self.scale == "log10":
            low, high = np.log10(abs(self.low)), np.log10(abs(self.high))
            # Not low + z (high - low), which can miss the upper end by rounding.
            value = self._sign * 10.0 ** (low * (1 - z) + high * z)
        else:
            value = self.low * (1 - z) + self.high * z
        # Half up, as people do; `round` would take 2.5 and 3.5 to 2 and 4.
        if self.integer:
            value = np.floor(value + 0.5)
        value = float(min(max(value, self.low), self.high))
        # Undo the rounding of encode and decode: a proposed value was a round number.
        nearest = value if self.integer else self.round(value)
        return nearest if abs(nearest - value) <= _DECODED * abs(self.high - self.low) else value

    def encode(self, value: float) -> float:
        """Return the unit coordinate in [0, 1] of a physical value in `unit`."""
        if self.scale == "log10":
            z = np.log10(value / self.low) / np.log10(self.high / self.low)
        else:
            z = (value - self.low) / (self.high - self.low)
        return float(min(max(z, 0.0), 1.0))

    def decode_all(self, z: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Decode many coordinates at once, up to rounding and without rounding integers, (m,)."""
        log = self.scale == "log10"
        low, high = (np.log10(abs(v)) if log else v for v in (self.low, self.high))
        value = low * (1 - z) + high * z
        return np.asarray(self._sign * 10.0**value if log else value)

    def encode_all(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Encode many physical values at once, up to rounding, shape (m,)."""
        if self.scale == "log10":
            return np.asarray(np.log10(values / self.low) / np.log10(self.high / self.low))
        return np.asarray((values - self.low) / (self.high - self.low))

    def round_all(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Round many values at once, without cutting powers of the step to a few digits, (m,)."""
        step = self.resolution
        if self.scale == "log10" and not self.integer:
            count = np.floor(np.log(values / self.low) / np.log1p(step) + 0.5)
            near = self.low * (1 + step) ** count
        else:
            near = np.floor(values / step + 0.5) * step
        near = np.clip(near, self.low, self.high)
        for end in (self.low, self.high):
            near = np.where(np.abs(end - values) < np.abs(near - values), end, near)
        return np.asarray(near)


def too_close(low: float, high: float, *, integer: bool) -> bool:
    """Return whether a range holds too few floats to be searched.

    An integer range may be small as long as rounding (see `exact`) cannot confuse two neighbors.
    """
    size = max(abs(low), abs(high))
    if integer and _ROUNDING * size < 0.5:
        return False
    return high - low < _FEWEST * ulp(size)


def default_step(low: float, high: float, scale: str) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is at most 1/100 of the range.

    On a log10 scale the step is relative: 1 + step is at most the hundredth root of the ratio of both ends.
    """
    if scale == "log10":
        most, size = 10.0 ** (abs(log10(abs(high)) - log10(abs(low))) / _SHARE) - 1.0, 1.0
    else:
        most, size = (high - low) / _SHARE, max(abs(low), abs(high))
    if most <= _FINEST * size:
        return 0.0  # the range holds hardly more floats than that
    power = 10.0 ** floor(log10(most))
    # A hundredth of the range may be just below a round number by rounding.
    lead = next(lead for lead in (5.0, 2.0, 1.0) if lead * power <= most * (1 + 1e-9))
    # A power of ten below 1 is no double: this is the one that people write.
    return float(f"{lead * power:.1g}")


def _problem(knob: Knob) -> str:
    """Return what is wrong with the range, the scale or the kind of a knob; "" if nothing is."""
    low, high = knob.low, knob.high
    if not isinstance(knob.unit, str):
        return f"unit must be text, got {knob.unit!r}"
    box = f"got [{low}, {high}] {knob.unit}".rstrip()
    if not (is_number(low) and is_number(high)):
        return f"low and high must be numbers, {box}"
    if not (isfinite(low) and isfinite(high)):
        return f"low and high must be finite, {box}"
    if not low < high:
        return f"low must be below high, {box}"
    if not isfinite(float(high) - float(low)):
        return f"high minus low must be below 1.8e308, {box}"
    if not isinstance(knob.integer, bool | np.bool_):
        return f"integer must be True or False, got {knob.integer!r}"
    if too_close(float(low), float(high), integer=knob.integer):
        return (
            f"low and high are too close, hardly a number lies between them, {box}: tune the "
            "distance from one of them instead"
        )
    if knob.scale not in get_args(KnobScale):
        return f"scale must be one of {get_args(KnobScale)}, got {knob.scale!r}"
    if knob.scale == "log10" and (low <= 0 <= high or max(low / high, high / low) > 1e300):
        return f"a log10 scale needs low above 0, or high below 0, {box}"
    if knob.integer and (low != round(low) or high != round(high)):
        return f"an integer knob needs integer bounds, {box}"
    return "" if knob.step is None else _step_problem(knob, knob.step)


def _step_problem(knob: Knob, step: Any) -> str:
    unit = "relative" if knob.scale == "log10" and not knob.integer else knob.unit
    got = f"got {step!r} {unit}".rstrip()
    if not is_number(step) or not isfinite(step) or step < 0:
        return f"step must be a number, 0 or more, {got}"
    ratio = max(knob.high / knob.low, knob.low / knob.high) if unit == "relative" else 1.0
    widest = ratio - 1 if unit == "relative" else knob.high - knob.low
    if step > widest:
        return f"step must be at most {widest:g}, the range, {got}"
    if knob.integer and (step < 1 or step != round(step)):
        return f"an integer knob needs an integer step, {got}"
    return ""


# --- Known constraints on θ: rule out experiments that are known not to work.

Values = Mapping[str, Any]
"""Maps a knob name to its physical value: a number, or an array (m,) if `vectorized`."""
_TERM_ROUNDING = 1e-12  # relative to the terms of a linear constraint: accept 0.1 + 0.2 <= 0.3


@dataclass(frozen=True, slots=True)
class Constraint:
    """A constraint that allows θ where `g` is 0 or less; where `g` is NaN, θ is not allowed.

    Args:
        name: Name for error messages and study files, which hold no code.
        g: Function of a mapping from knob name to physical value. Its unit is up to you; the search
            works best if its values near the boundary are of similar size for all θ.
        vectorized: Whether `g` accepts arrays, one value for each of m θ. This is faster, but `g`
            must use numpy's functions in place of max, abs, if and math.

    Raises:
        KnobError: If the name is empty or `g` is not callable.
    """

    name: str
    g: Callable[[Values], Any]
    vectorized: bool = False

    def __post_init__(self) -> None:
        _check_name(self.name)
        if not callable(self.g):
            raise KnobError(
                f"constraint {self.name!r}: g must be a function of a mapping from knob name to "
                f"value, got {self.g!r}"
            )

    def check_names(self, names: tuple[str, ...]) -> None:
        """Accept any knob names: which ones `g` reads is known only when it is called."""

    def __call__(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> Float[np.ndarray, " m"]:
        """Return g at m θ, given as one array (m,) for each knob; shape (m,).

        Raises:
            KnobError: If `g` raises an error or does not return one number for each θ.
        """
        count = len(next(iter(values.values())))
        result = self._called(values) if self.vectorized else self._one_by_one(values)
        if result.shape not in ((), (count,)):
            raise KnobError(
                f"constraint {self.name!r} must return one number for each θ (0 or less "
                f"where θ is allowed), got shape {result.shape} for {count} θ"
            )
        return np.broadcast_to(result, (count,))

    def _one_by_one(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> np.ndarray:
        # Plain Python numbers: user code compares them, and they are readable in error messages.
        columns = [np.asarray(column).tolist() for column in values.values()]
        rows = (dict(zip(values, row, strict=True)) for row in zip(*columns, strict=True))
        return np.array([self._called(row) for row in rows], dtype=float)

    def _called(self, values: Values) -> np.ndarray:
        try:
            return np.asarray(self.g(values), dtype=float)
        except Exception as error:  # the user's own function can raise anything
            raise KnobError(
                f"constraint {self.name!r} cannot be computed at {dict(values)}: "
                f"{type(error).__name__}: {error}"
            ) from error


@dataclass(frozen=True, slots=True, init=False)
class LinearConstraint:
    """A linear constraint in physical units: Σ coefficient · knob <= at_most.

    Args:
        name: Name for error messages and study files.
        coefficients: Maps a knob name to its coefficient; other knobs have coefficient 0.
        at_most: Upper bound.

    Raises:
        KnobError: If the name is empty, there is no coefficient, or a number is not finite.
    """

    name: str
    coefficients: tuple[tuple[str, float], ...]
    at_most: float

    def __init__(self, name: str, coefficients: Mapping[str, float], at_most: float) -> None:
        _check_name(name)
        if not isinstance(coefficients, Mapping) or not coefficients:
            raise KnobError(
                f"constraint {name!r}: coefficients must map one or more knob names to numbers, "
                f"got {coefficients!r}"
            )
        for what, value in [*coefficients.items(), ("at_most", at_most)]:
            if not is_number(value) or not isfinite(value):
                raise KnobError(f"constraint {name!r}: {what} must be a finite number, got {value!r}")
        object.__setattr__(self, "name", name)
        pairs = tuple((knob, float(c)) for knob, c in coefficients.items())
        object.__setattr__(self, "coefficients", pairs)
        object.__setattr__(self, "at_most", float(at_most))

    def check_names(self, names: tuple[str, ...]) -> None:
        """Raise KnobError if a coefficient belongs to a knob that is not in `names`."""
        strangers = [knob for knob, _ in self.coefficients if knob not in names]
        if strangers:
            raise KnobError(
                f"constraint {self.name!r} names {strangers}, which are not among the knobs {names}"
            )

    def __call__(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> Float[np.ndarray, " m"]:
        """Return left side minus bound at m θ, given as one array (m,) for each knob; (m,)."""
        terms = np.array([c * values[knob] for knob, c in self.coefficients])
        # Rounding grows with the largest term, not with the difference, which may be 0.
        largest = np.maximum(np.max(np.abs(terms), axis=0), abs(self.at_most))
        return np.asarray(np.sum(terms, axis=0) - self.at_most - _TERM_ROUNDING * largest)


AnyConstraint = Constraint | LinearConstraint


def _check_name(name: object) -> None:
    if not (isinstance(name, str) and name.strip()):
        raise KnobError(f"a constraint needs a name, got {name!r}")


def check_constraints(constraints: object, names: tuple[str, ...]) -> tuple[AnyConstraint, ...]:
    """Return `constraints` as a tuple. Raises KnobError if they do not fit the knobs `names`."""
    if isinstance(constraints, str) or not isinstance(constraints, Iterable):
        raise KnobError(f"constraints must be a sequence of constraints, got {constraints!r}")
    found: tuple[AnyConstraint, ...] = tuple(constraints)
    for constraint in found:
        if not isinstance(constraint, (Constraint, LinearConstraint)):
            raise KnobError(f"expected a Constraint or a LinearConstraint, got {constraint!r}")
        constraint.check_names(names)
    titles = [constraint.name for constraint in found]
    duplicates = {title for title in titles if titles.count(title) > 1}
    if duplicates:
        raise KnobError(f"constraint names must differ, got {sorted(duplicates)} more than once")
    return found


# --- A space of knobs: the one place where the unit cube meets physical units.

_TOUCHING = 1e-6  # tolerance in steps: neighbors on the grid are one step apart, up to rounding
_NARROWEST = 1e-9  # narrowest part of a knob's range that can be searched, in the unit cube


@dataclass(frozen=True)
class KnobSpace:
    """The search space of θ: an ordered collection of knobs, with constraints.

    Deviation: [0, 1] for each knob, where the authors' code scales to [-1, 1]; the paper names no
    box. Distances are half as long, so δ of eq. acquisition acts up to 16 times weaker. Measured
    in docs/deviations.md.

    Args:
        knobs: One or more knobs.
        constraints: Constraints that every proposed θ satisfies. `decode`, `encode` and `check`
            ignore them and know only the box, since plots also show the points outside.
        within: Maps a knob name to the physical range (low, high) that is still searched; equal
            values freeze the knob. Experiments outside this range still teach the agent.

    Raises:
        KnobError: If there are no knobs, an item is not a `Knob` or a constraint, two names are
            equal, a linear constraint names an unknown knob, or `within` does not fit the knobs.
    """

    knobs: tuple[Knob, ...]
    constraints: tuple[AnyConstraint, ...]
    within: tuple[tuple[float, float], ...]
    corners: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]] = field(
        init=False, repr=False, compare=False
    )
    """Lower and upper corner of the searched box in the unit cube, each of shape (n,)."""

    def __init__(
        self,
        knobs: Sequence[Knob],
        constraints: Sequence[AnyConstraint] = (),
        *,
        within: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        if isinstance(knobs, Knob) or not isinstance(knobs, Iterable):
            raise KnobError(f"a knob space needs a sequence of Knobs, got {knobs!r}")
        object.__setattr__(self, "knobs", tuple(knobs))
        strangers = [k for k in self.knobs if not isinstance(k, Knob)]
        if not self.knobs or strangers:
            raise KnobError(f"a knob space needs one or more Knobs, got {strangers or 'none'}")
        duplicates = {n for n in self.names if self.names.count(n) > 1}
        if duplicates:
            raise KnobError(f"knob names must differ, got {sorted(duplicates)} more than once")
        object.__setattr__(self, "constraints", check_constraints(constraints, self.names))
        object.__setattr__(self, "within", _parts(self.knobs, within or {}))
        corners = tuple(self.encode(np.array(each)) for each in zip(*self.within, strict=True))
        for corner in corners:
            corner.flags.writeable = False
        object.__setattr__(self, "corners", corners)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the knobs, in order of `knobs`."""
        return tuple(k.name for k in self.knobs)

    @property
    def frozen(self) -> tuple[bool, ...]:
        """Whether each knob is frozen at one value."""
        return tuple(low == high for low, high in self.within)

    @property
    def integers(self) -> Bool[np.ndarray, " n"]:
        """Which knobs are integers, shape (n,)."""
        return np.array([knob.integer for knob in self.knobs], dtype=np.bool_)

    def narrowed(self, within: Mapping[str, tuple[float, float]]) -> "KnobSpace":
        """Return this space with a smaller searched range; other knobs keep theirs.

        Raises:
            KnobError: If `within` does not fit the knobs, as in the constructor.
        """
        now = dict(zip(self.names, self.within, strict=True))
        return KnobSpace(self.knobs, self.constraints, within={**now, **within})

    def described(self, about: Mapping[str, str]) -> "KnobSpace":
        """Return this space with a sentence for each knob, by name, on what the knob does.

        Raises:
            KnobError: If no knob has one of the names.
        """
        unknown = sorted(set(about) - set(self.names))
        if unknown:
            raise KnobError(f"about must name some of the knobs {self.names}, got {unknown}")
        knobs = [replace(k, about=about.get(k.name, k.about)) for k in self.knobs]
        within = dict(zip(self.names, self.within, strict=True))
        return KnobSpace(knobs, self.constraints, within=within)

    def searches(self, theta: Float[np.ndarray, " n"]) -> bool:
        """Return whether a physical θ, shape (n,), lies in the searched range."""
        theta = self._vector(theta, "theta")
        return all(low <= v <= high for (low, high), v in zip(self.within, theta, strict=True))

    def __len__(self) -> int:
        return len(self.knobs)

    def __iter__(self) -> Iterator[Knob]:
        return iter(self.knobs)

    def decode(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Map a point of the unit cube, shape (n,), to physical units.

        Raises:
            KnobError: If the shape is wrong, or a coordinate is NaN or outside [0, 1].
        """
        z = self._vector(z, "z")
        for knob, zi in zip(self.knobs, z, strict=True):
            if not 0.0 <= zi <= 1.0:
                raise KnobError(f"z of knob {knob.name!r} must be in [0, 1], got {zi}")
        return np.asarray(self._decode(z[None])[0])

    def encode(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Map a physical θ, shape (n,), to the unit cube.

        Raises:
            KnobError: If θ is not valid, as in `check`.
        """
        theta = self.check(theta)
        return np.array([k.encode(v) for k, v in zip(self.knobs, theta, strict=True)])

    def snap(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the cube point of the θ proposed for `z`, shape (n,), with rounded knob values.

        Each knob is rounded to its resolution, unless the constraints forbid the rounded θ but
        allow the unrounded one. All `z` with the same proposed θ give the same point.
        """
        theta = self.decode(z)
        parts = zip(self.knobs, theta, self.within, strict=True)
        rounded = np.array([knob.round_within(value, part) for knob, value, part in parts])
        # At the edge of the region rounding may lead outside: better a long number than a forbidden one.
        if self.constraints and not self.allows(rounded) and self.allows(theta):
            rounded = theta
        return self.encode(rounded)

    def proposals(
        self, z: Float[np.ndarray, "m n"]
    ) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m n"]]:
        """Return many points as `snap` gives each, and their θ as `decode` does, both (m, n).

        They are the same to the last bit, since each value is computed by itself; those of
        `snap_all` and `decode_all` are not.
        """
        thetas = self._decode(z)
        rounded = thetas.copy()
        for k, (knob, part) in enumerate(zip(self.knobs, self.within, strict=True)):
            # By Python's functions for each value: numpy's differ in the last bit, and a θ must be one θ.
            near = np.clip(list(map(knob.round, thetas[:, k])), *part)
            rounded[:, k] = np.where(np.isin(thetas[:, k], part), thetas[:, k], near)
        if self.constraints:
            stay = ~np.atleast_1d(self.allows(rounded)) & self.allows(thetas)
            rounded[stay] = thetas[stay]
        columns = [list(map(k.encode, values)) for k, values in zip(self.knobs, rounded.T, strict=True)]
        snapped = np.array(columns).T.reshape(z.shape)
        return snapped, self._decode(snapped)

    def _decode(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Return θ of many points of the cube, each value as `decode` computes it, shape (m, n)."""
        thetas = np.empty(z.shape)
        for k, (knob, part) in enumerate(zip(self.knobs, self.within, strict=True)):
            thetas[:, k] = [knob.exact(knob.decode(zi), part) for zi in z[:, k]]
        return thetas

    def scaled(self, w: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Return points `w` of a unit cube, shape (m, n), scaled to the searched part."""
        lower, upper = self.corners
        return np.asarray(lower + (upper - lower) * w)

    def snap_all(
        self, z: Float[np.ndarray, "m n"], *, only_integers: bool = False
    ) -> Float[np.ndarray, "m n"]:
        """Round many points at once like `snap` without constraints, up to rounding, shape (m, n).

        Points outside the searched range move to its border.
        """
        lower, upper = self.corners
        snapped = np.asarray(np.clip(z, lower, upper))
        for k, knob in enumerate(self.knobs):
            if knob.resolution == 0 or (only_integers and not knob.integer):
                continue
            # For searches, where the last bit does not matter: what is proposed goes through `snap`.
            column = knob.encode_all(knob.round_all(knob.decode_all(snapped[:, k])))
            snapped[:, k] = np.clip(column, lower[k], upper[k])
        return snapped

    def decode_all(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Decode many points at once like `decode`, up to rounding, shape (m, n)."""
        thetas = np.empty(z.shape)
        for k, knob in enumerate(self.knobs):
            values = knob.decode_all(z[:, k])
            values = np.floor(values + 0.5) if knob.integer else values
            thetas[:, k] = np.clip(values, knob.low, knob.high)
        return thetas

    def encode_all(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        """Encode many physical θ at once like `encode`, up to rounding, shape (m, n).

        Raises:
            KnobError: If `thetas` has another shape or leaves the box.
        """
        if np.ndim(thetas) != 2 or np.shape(thetas)[1] != len(self):
            raise KnobError(f"thetas must have shape (m, {len(self)}), got {np.shape(thetas)}")
        z = np.empty(np.shape(thetas))
        inside = np.ones(len(thetas), dtype=np.bool_)
        for k, knob in enumerate(self.knobs):
            values = thetas[:, k]
            whole = values == np.round(values) if knob.integer else True
            here = (knob.low <= values) & (values <= knob.high) & whole
            inside &= here
            z[:, k] = knob.encode_all(np.where(here, values, knob.low))
        for theta in thetas[~inside][:1]:
            self.check(theta)  # says what is wrong with it
        return np.clip(z, 0.0, 1.0)

    def close(
        self, theta: Float[np.ndarray, " n"], others: Float[np.ndarray, "m n"]
    ) -> Bool[np.ndarray, " m"]:
        """Return which of `others`, physical, are less than a step from `theta` in each knob.

        People cannot tell such experiments apart, nor dial them in. A knob without a step must be
        equal. Shape (m,).
        """
        close = np.ones(len(others), dtype=np.bool_)
        for k, knob in enumerate(self.knobs):
            if knob.resolution == 0:
                close &= others[:, k] == theta[k]
                continue
            away = np.abs(knob.steps(others[:, k]) - knob.steps(theta[k : k + 1]))
            close &= away < 1 - _TOUCHING
        return close

    def check(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return a valid physical `theta` as a float array, shape (n,).

        Raises:
            KnobError: If the shape is wrong, or a value is NaN, outside the box, or a fraction for
                an integer knob.
        """
        theta = self._vector(theta, "theta")
        for knob, value in zip(self.knobs, theta.tolist(), strict=True):
            if not knob.low <= value <= knob.high:
                raise KnobError(
                    f"theta of knob {knob.name!r} must be in [{knob.low}, {knob.high}] {knob.unit}".rstrip()
                    + f", got {value}"
                )
            if knob.integer and value != round(value):
                raise KnobError(f"theta of knob {knob.name!r} must be an integer, got {value}")
        return theta

    def allows(self, theta: Float[np.ndarray, "*m n"]) -> Bool[np.ndarray, "*m"] | bool:
        """Return whether constraints allow a physical θ, shape (n,), or each of m, shape (m, n).

        Raises:
            KnobError: If the shape is wrong or a constraint cannot be computed.
        """
        thetas = np.asarray(theta, dtype=float)
        if thetas.ndim == 1:
            return bool(np.all(self.excess(self._vector(thetas, "theta")[None]) <= 0))
        return np.asarray(np.all(self.excess(thetas) <= 0, axis=1))

    def excess(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m c"]:
        """Return the c constraints at m physical θ, shape (m, c): 0 or less where allowed.

        Raises:
            KnobError: If the shape is wrong or a constraint cannot be computed.
        """
        if np.ndim(thetas) != 2 or np.shape(thetas)[1] != len(self):
            raise KnobError(f"thetas must have shape (m, {len(self)}), got {np.shape(thetas)}")
        if not self.constraints or not len(thetas):
            return np.zeros((len(thetas), len(self.constraints)))
        values = {name: thetas[:, k] for k, name in enumerate(self.names)}
        return np.array([constraint(values) for constraint in self.constraints]).T

    def check_allowed(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return `theta` as a float array, shape (n,), if the constraints allow it.

        Raises:
            KnobError: If θ is not valid, as in `check`, or a constraint forbids it.
        """
        theta = self.check(theta)
        for constraint, g in zip(self.constraints, self.excess(theta[None])[0], strict=True):
            # So written, NaN is forbidden.
            if not g <= 0:
                raise KnobError(
                    f"constraint {constraint.name!r} must be 0 or less, got {g:g} at "
                    f"theta {self.named(theta)}"
                )
        return theta

    def named(self, theta: Float[np.ndarray, " n"]) -> dict[str, float]:
        """Return a dict from knob name to physical value, in order; integer knobs as int."""
        theta = self.check(theta)
        return {k.name: int(v) if k.integer else float(v) for k, v in zip(self.knobs, theta, strict=True)}

    def _vector(self, values: object, what: str) -> Float[np.ndarray, " n"]:
        try:
            vector = np.array(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise KnobError(f"{what} must be numbers, got {values!r}") from error
        if vector.shape != (len(self),):
            raise KnobError(
                f"{what} must have shape ({len(self)},), one value each of {self.names}, "
                f"got shape {vector.shape}"
            )
        if not np.isfinite(vector).all():
            raise KnobError(
                f"{what} must be finite, got {dict(zip(self.names, vector.tolist(), strict=True))}"
            )
        return vector


def _parts(
    knobs: Sequence[Knob], within: Mapping[str, tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return the searched physical range of each knob, in order; by default its whole range."""
    unknown = sorted(set(within) - {knob.name for knob in knobs})
    if unknown:
        raise KnobError(f"within must name existing knobs, got {unknown}")
    found = {knob.name: (float(knob.low), float(knob.high)) for knob in knobs}
    for knob in knobs:
        if knob.name not in within:
            continue
        low, high = within[knob.name]
        box = f"[{knob.low}, {knob.high}] {knob.unit}".rstrip()
        if not (is_number(low) and is_number(high) and knob.low <= low <= high <= knob.high):
            raise KnobError(f"knob {knob.name!r}: expected a part of {box}, got {low} to {high}")
        if knob.integer and (low != round(low) or high != round(high)):
            raise KnobError(f"knob {knob.name!r}: expected integers, got {low} to {high}")
        if low < high and (
            knob.encode(high) - knob.encode(low) < _NARROWEST
            or too_close(float(low), float(high), integer=knob.integer)
        ):
            raise KnobError(
                f"knob {knob.name!r}: {low} to {high} is too narrow to search: freeze the knob "
                "by giving the same value twice"
            )
        # Replace a border that differs from an end of the range only by rounding.
        ends = (float(knob.low), float(knob.high))
        found[knob.name] = (knob.exact(float(low), ends), knob.exact(float(high), ends))
    return tuple(found.values())


# --- Change a space of knobs without losing any θ that was tried.


def respaced(old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None) -> KnobSpace:
    """Return a space that searches the ranges of `new` and includes every θ of `old`.

    If a range was narrowed, the search stays inside it, but agents still learn from the experiments
    outside.

    Args:
        old: Space of the experiments so far.
        new: Space to search from now on; it must have all knobs of `old`.
        added: Maps each knob that is not in `old` to its physical value in the experiments so far.

    Raises:
        KnobError: If a knob is missing, has another scale, unit or kind, or its value in the
            experiments so far is not known.
    """
    added = dict(added or {})
    before = {knob.name: knob for knob in old}
    missing = sorted(set(before) - set(new.names))
    if missing:
        raise KnobError(f"knobs {missing} are missing: keep them, frozen at one value")
    fresh = [name for name in new.names if name not in before]
    if sorted(added) != sorted(fresh):
        raise KnobError(
            f"values in the experiments so far are needed for the added knobs {fresh}, got {sorted(added)}"
        )
    knobs = [
        _wider(knob, before[knob.name])
        if knob.name in before
        else _include(knob, added[knob.name], added[knob.name])
        for knob in new
    ]
    # The box grows so that old θ keep their place; only what is searched is the new range.
    within = dict(zip(new.names, new.within, strict=True))
    return KnobSpace(knobs, new.constraints, within=within)


def carry(
    theta: Float[np.ndarray, " m"], old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None
) -> Float[np.ndarray, " n"]:
    """Return a physical θ of `old`, shape (m,), as a θ of `new`, shape (n,), with `added` values.

    Raises:
        KnobError: If `new` does not hold it, or has a knob without a value.
    """
    values = {**dict(zip(old.names, theta.tolist(), strict=True)), **(added or {})}
    unknown = [name for name in new.names if name not in values]
    if unknown:
        raise KnobError(f"no value is known for the knobs {unknown}")
    # By name: the knobs of the new space may be in another order.
    return new.check(np.array([float(values[name]) for name in new.names]))


def _wider(new: Knob, old: Knob) -> Knob:
    kind, was = (new.unit, new.scale, new.integer), (old.unit, old.scale, old.integer)
    if kind[1:] != was[1:] or not same(new.unit, old.unit):
        raise KnobError(
            f"knob {new.name!r} must keep its unit, scale and kind {was}, got {kind}: "
            "give the new knob another name"
        )
    return _include(new, old.low, old.high)


def _include(knob: Knob, low: float, high: float) -> Knob:
    return replace(knob, low=min(knob.low, low), high=max(knob.high, high))
