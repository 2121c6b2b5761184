"""A knob: one tunable number, its resolution, and its place in the unit interval."""

from dataclasses import dataclass, field
from math import floor, isfinite, log, log1p, log10, ulp
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError

Scale = Literal["linear", "log10"]

_DECODED = 1e-12  # error of decoding a proposed value, as a share of the knob's range
_SHARE = 100  # the default step is at most the range divided by this
_FINEST = 1e-13  # smallest step relative to the values: below it, doubles cannot be rounded
_DIGITS = 15  # significant digits of a double that survive a multiplication
_FEWEST = 2**13  # fewest floats in a range: about a hundred that differ by more than rounding
_ROUNDING = 1e-14
"""Error of decoding, relative to a linear knob's bounds or a log10 knob's value."""


@dataclass(frozen=True, slots=True)
class Knob:
    """A tunable number between `low` and `high`, both inclusive and in `unit`.

    Args:
        name: Name of the knob, as shown to people.
        low: Smallest value.
        high: Largest value.
        unit: Unit of both bounds.
        scale: "linear" if differences count, "log10" if ratios count.
        integer: Whether only whole numbers are valid.
        step: Resolution, in `unit`: the smallest change that a person can dial in or notice. On a
            log10 scale it is relative: 0.02 is 2 %. Proposed values are multiples of it. None
            picks a round number between 1/250 and 1/100 of the range, or 1 for an integer knob; 0
            proposes any value.
        about: One sentence that tells people what the knob does. It is ignored when knobs are
            compared, and is not saved in study files.

    Raises:
        KnobError: If the bounds are reversed, equal or infinite, lie so close that hardly a number
            fits between them, or have an infinite difference; if a log10 knob is not positive, an
            integer knob has bounds that are not integers, `integer` is neither True nor False, the
            name is empty, the scale is unknown, or the step is negative, wider than the range, or a
            fraction for an integer knob.
    """

    name: str
    low: float
    high: float
    unit: str = ""
    scale: Scale = "linear"
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

    def round(self, value: float) -> float:
        """Return the valid proposal nearest to `value`, both in `unit`.

        Valid proposals are the multiples of the resolution (on a log10 scale `low` times a power
        of 1 + step, rounded to a few digits) and the two ends of the range.
        """
        step = self.resolution
        if step == 0:
            return value
        if self.scale == "log10" and not self.integer:
            count = floor(log(value / self.low) / log1p(step) + 0.5)
            near = float(f"{self.low * (1 + step) ** count:.{_digits(step)}g}")
        else:
            near = float(f"{floor(value / step + 0.5) * step:.{_DIGITS}g}")
        near = min(max(near, self.low), self.high)
        return min((near, self.low, self.high), key=lambda end: abs(end - value))

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
            return np.asarray(np.log(values / self.low) / np.log1p(step))
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
            values = self.low * (1 + self.resolution) ** inside
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
            value = 10.0 ** (np.log10(self.low) * (1 - z) + np.log10(self.high) * z)
        else:
            value = self.low * (1 - z) + self.high * z
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
        low, high = (np.log10(v) if self.scale == "log10" else v for v in (self.low, self.high))
        value = low * (1 - z) + high * z
        return np.asarray(10.0**value if self.scale == "log10" else value)

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


def is_number(value: object) -> bool:
    """Return whether `value` is a number of Python or numpy; booleans are not numbers."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


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

    On a log10 scale the step is relative: 1 + step is at most the hundredth root of high / low.
    """
    if scale == "log10":
        most, size = 10.0 ** ((log10(high) - log10(low)) / _SHARE) - 1.0, 1.0
    else:
        most, size = (high - low) / _SHARE, max(abs(low), abs(high))
    if most <= _FINEST * size:
        return 0.0  # the range holds hardly more floats than that
    power = 10.0 ** floor(log10(most))
    lead = next(lead for lead in (5.0, 2.0, 1.0) if lead * power <= most * (1 + 1e-9))
    return float(f"{lead * power:.1g}")


def _problem(knob: Knob) -> str:
    """Return what is wrong with the range, the scale or the kind of a knob; "" if nothing is."""
    low, high = knob.low, knob.high
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
    if knob.scale not in get_args(Scale):
        return f"scale must be one of {get_args(Scale)}, got {knob.scale!r}"
    if knob.scale == "log10" and (low <= 0 or high / 1e300 > low):
        return f"a log10 scale needs low above 0, {box}"
    if knob.integer and (low != round(low) or high != round(high)):
        return f"an integer knob needs integer bounds, {box}"
    return "" if knob.step is None else _step_problem(knob, knob.step)


def _step_problem(knob: Knob, step: Any) -> str:
    unit = "relative" if knob.scale == "log10" and not knob.integer else knob.unit
    got = f"got {step!r} {unit}".rstrip()
    if not is_number(step) or not isfinite(step) or step < 0:
        return f"step must be a number, 0 or more, {got}"
    widest = knob.high / knob.low - 1 if unit == "relative" else knob.high - knob.low
    if step > widest:
        return f"step must be at most {widest:g}, the range, {got}"
    if knob.integer and (step < 1 or step != round(step)):
        return f"an integer knob needs an integer step, {got}"
    return ""


def _digits(step: float) -> int:
    """Return how many significant digits separate neighbors on a log10 scale, plus two."""
    return max(2, 2 - floor(log10(step)))
