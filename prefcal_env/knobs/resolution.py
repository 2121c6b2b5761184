"""Resolution of a knob: the round numbers that its proposed values are taken from."""

from math import floor, log, log1p, log10
from typing import Protocol

_SHARE = 100  # the default step is at most the range divided by this
_FINEST = 1e-13  # smallest step relative to the values: below it, doubles cannot be rounded
_DIGITS = 15  # significant digits of a double that survive a multiplication


class Stepped(Protocol):
    """The attributes of a `Knob` that this module needs."""

    @property
    def low(self) -> float:
        """Lower end, inclusive."""

    @property
    def high(self) -> float:
        """Upper end, inclusive."""

    @property
    def scale(self) -> str:
        """Scale: "linear" or "log10"."""

    @property
    def integer(self) -> bool:
        """Whether only whole numbers are valid."""

    @property
    def resolution(self) -> float:
        """Step in use; 0 if there is none."""


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


def nearest_step(knob: Stepped, value: float) -> float:
    """Return the multiple of the knob's step, or the end of its range, nearest to `value`."""
    step = knob.resolution
    if step == 0:
        return value
    if knob.scale == "log10" and not knob.integer:
        count = floor(log(value / knob.low) / log1p(step) + 0.5)
        near = float(f"{knob.low * (1 + step) ** count:.{_digits(step)}g}")
    else:
        near = float(f"{floor(value / step + 0.5) * step:.{_DIGITS}g}")
    near = min(max(near, knob.low), knob.high)
    return min((near, knob.low, knob.high), key=lambda end: abs(end - value))


def _digits(step: float) -> int:
    """Return how many significant digits separate neighbors on a log10 scale, plus two."""
    return max(2, 2 - floor(log10(step)))
