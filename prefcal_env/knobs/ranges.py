"""Parts of knobs' ranges: what is still searched of each."""

from collections.abc import Mapping, Sequence
from math import ulp
from typing import Protocol

import numpy as np

from prefcal_env.errors import KnobError

_ROUNDING = 1e-14  # of decoding, by the size of a linear knob's bounds or a log10 knob's value
_FEWEST = 2**13  # numbers in a range: a hundred that differ by more than rounding
_NARROWEST = 1e-9  # part of a knob's range that can be searched, in the unit cube


class Ranged(Protocol):
    """What is needed of a `Knob` here."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def low(self) -> float:
        """Lower end, inclusive."""

    @property
    def high(self) -> float:
        """Upper end, inclusive."""

    @property
    def unit(self) -> str:
        """Of both."""

    @property
    def scale(self) -> str:
        """Linear or log10."""

    @property
    def integer(self) -> bool:
        """Whether it is one."""

    def encode(self, value: float) -> float:
        """Unit coordinate of a physical value."""


def is_number(value: object) -> bool:
    """Whether it is one, of Python or numpy; truth values are none."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def too_close(low: float, high: float, *, integer: bool) -> bool:
    """Whether a range holds too few numbers to be searched; what is `integer` may hold few.

    As long as rounding (see `exact`) takes none of them for its neighbor.
    """
    size = max(abs(low), abs(high))
    if integer and _ROUNDING * size < 0.5:
        return False
    return high - low < _FEWEST * ulp(size)


def exact(knob: Ranged, value: float, part: tuple[float, float]) -> float:
    """`value`, or the border of `part` that it missed by rounding."""
    for border in part:
        size = abs(border) if knob.scale == "log10" else max(abs(knob.low), abs(knob.high))
        if abs(value - border) <= _ROUNDING * size:
            return border
    return value


def parts(
    knobs: Sequence[Ranged], within: Mapping[str, tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """What is searched of each knob, in their order, physical; all of those not in `within`.

    Raises:
        KnobError: an unknown knob, or a range that is no part of the knob's.
    """
    unknown = sorted(set(within) - {knob.name for knob in knobs})
    if unknown:
        raise KnobError(f"there are no knobs {unknown} to be searched within a range")
    found = {knob.name: (float(knob.low), float(knob.high)) for knob in knobs}
    for knob in knobs:
        if knob.name not in within:
            continue
        low, high = within[knob.name]
        box = f"[{knob.low}, {knob.high}] {knob.unit}".rstrip()
        if not (is_number(low) and is_number(high) and knob.low <= low <= high <= knob.high):
            raise KnobError(
                f"knob {knob.name!r}: a part of {box} was expected, got {low} to {high}"
            )
        if knob.integer and (low != round(low) or high != round(high)):
            raise KnobError(f"knob {knob.name!r}: integers were expected, got {low} to {high}")
        if low < high and (
            knob.encode(high) - knob.encode(low) < _NARROWEST
            or too_close(float(low), float(high), integer=knob.integer)
        ):
            raise KnobError(
                f"knob {knob.name!r}: {low} to {high} is too narrow to be searched: freeze it, "
                "with one value as both"
            )
        # A border that is an end of the range up to rounding is that end.
        ends = (float(knob.low), float(knob.high))
        found[knob.name] = (exact(knob, float(low), ends), exact(knob, float(high), ends))
    return tuple(found.values())
