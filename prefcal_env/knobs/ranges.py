"""Searched parts of the knobs' ranges, and their limits of floating-point resolution."""

from collections.abc import Mapping, Sequence
from math import ulp
from typing import Protocol

import numpy as np

from prefcal_env.errors import KnobError

_ROUNDING = 1e-14  # error of decoding, relative to a linear knob's bounds or a log10 knob's value
_FEWEST = 2**13  # fewest floats in a range: about a hundred that differ by more than rounding
_NARROWEST = 1e-9  # narrowest part of a knob's range that can be searched, in the unit cube


class Ranged(Protocol):
    """The attributes of a `Knob` that this module needs."""

    @property
    def name(self) -> str:
        """Name of the knob."""

    @property
    def low(self) -> float:
        """Lower end, inclusive."""

    @property
    def high(self) -> float:
        """Upper end, inclusive."""

    @property
    def unit(self) -> str:
        """Unit of both ends."""

    @property
    def scale(self) -> str:
        """Scale: "linear" or "log10"."""

    @property
    def integer(self) -> bool:
        """Whether only whole numbers are valid."""

    def encode(self, value: float) -> float:
        """Return the unit coordinate of a physical value."""


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


def exact(knob: Ranged, value: float, part: tuple[float, float]) -> float:
    """Return `value`, or the border of `part` if they differ only by rounding."""
    for border in part:
        size = abs(border) if knob.scale == "log10" else max(abs(knob.low), abs(knob.high))
        if abs(value - border) <= _ROUNDING * size:
            return border
    return value


def parts(
    knobs: Sequence[Ranged], within: Mapping[str, tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return the searched physical range of each knob, in order; by default its whole range.

    Raises:
        KnobError: If `within` names an unknown knob or a range outside the knob's range.
    """
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
        found[knob.name] = (exact(knob, float(low), ends), exact(knob, float(high), ends))
    return tuple(found.values())
