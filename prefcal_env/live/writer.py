"""Write to a live plant: the only place that does so, within limits and at a limited rate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import copysign, isfinite

from prefcal_env.errors import LiveError

from .parts import Written
from .plant import LivePlant

_ROUNDING = 1e-9
"""Relative error of sums and products of doubles, with a margin."""


@dataclass(frozen=True, slots=True)
class _Known:
    """Value of a node on the plant, since when it has it, and what it may be instead.

    If the connection is lost during a write, the plant has either of the two.
    """

    value: float
    since: float
    before: float


class Writer:
    """Writer of one plant. Every value that reaches the plant passes `_write`, which checks it.

    Args:
        plant: Plant to write to.
        written: Nodes that may be written to, by name.
        period: Sampling period in seconds.
        clock: Function that returns the time in seconds.
    """

    def __init__(
        self,
        plant: LivePlant,
        written: Mapping[str, Written],
        period: float,
        clock: Callable[[], float],
    ) -> None:
        self._plant, self._written = plant, written
        self._period, self._clock = period, clock
        self._known: dict[str, _Known] = {}

    def read(self) -> dict[str, float]:
        """Read all nodes that may be written to, by name; NaN for bad quality.

        Raises:
            ConnectionLostError: If the connection is lost.
        """
        nodes = [written.node for written in self._written.values()]
        values = dict(zip(self._written, self._plant.read(nodes), strict=True))
        self.see(values)
        return values

    def see(self, values: Mapping[str, float]) -> None:
        """Take note of the values that the plant has now."""
        now = self._clock()
        for name, value in values.items():
            known = self._known.get(name)
            if not isfinite(value):
                self._known.pop(name, None)  # unknown: nothing is written until it is known
            elif known is None or not self._explained(name, value, known):
                self._known[name] = _Known(value, now, value)
            else:
                self._known[name] = _Known(value, known.since, known.before)

    def _explained(self, name: str, value: float, known: _Known) -> bool:
        """Return whether the plant has what was written last, or what it had before."""
        same = self._written[name].same
        return same(value, known.value) or same(value, known.before)

    def step(self, targets: Mapping[str, float]) -> None:
        """Move each value one step toward its target, as far as its rate allows.

        Raises:
            ConnectionLostError: If the connection is lost; a value may have arrived.
            LiveError: If the plant refuses a value.
        """
        for name, target in targets.items():
            known, written = self._known.get(name), self._written[name]
            if known is None or written.same(known.value, target):
                continue
            allowed = written.step(self._clock() - known.since, self._period)
            way = target - known.value
            if abs(way) <= allowed * (1 + _ROUNDING):
                self._write(written, known, target)
            elif allowed:
                self._write(written, known, known.value + copysign(allowed, way))

    def _write(self, written: Written, known: _Known, value: float) -> None:
        """Check one value against limits and rate, then write it."""
        now = self._clock()
        allowed = written.step(now - known.since, self._period)
        if not (isfinite(value) and written.low <= value <= written.high):
            raise LiveError(
                f"{written.name} = {value:g} {written.unit} is outside "
                f"[{written.low:g}, {written.high:g}]: nothing was written"
            )
        if abs(value - known.value) > allowed * (1 + 2 * _ROUNDING):
            raise LiveError(
                f"{written.name} may change by {allowed:g} {written.unit} now, got "
                f"{known.value:g} to {value:g}: nothing was written"
            )
        try:
            self._plant.write(written.node, value)
        finally:
            # After an error, too: the value may have arrived, at the latest now.
            self._known[written.name] = _Known(value, self._clock(), known.value)
