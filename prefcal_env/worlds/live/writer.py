"""Write to a live plant within limits and rates, and notice if it comes no closer to a target."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import copysign, inf, isfinite

from prefcal_env.errors import LiveError

from .parts import LiveKnob
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
        self, plant: LivePlant, written: Mapping[str, LiveKnob], period: float, clock: Callable[[], float]
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

    def _write(self, written: LiveKnob, known: _Known, value: float) -> None:
        """Check one value against limits and rate, then write it."""
        now, knob = self._clock(), written.knob
        allowed = written.step(now - known.since, self._period)
        if not (isfinite(value) and knob.low <= value <= knob.high):
            raise LiveError(
                f"{knob.name} = {value:g} {knob.unit} is outside "
                f"[{knob.low:g}, {knob.high:g}]: nothing was written"
            )
        if abs(value - known.value) > allowed * (1 + 2 * _ROUNDING):
            raise LiveError(
                f"{knob.name} may change by {allowed:g} {knob.unit} now, got "
                f"{known.value:g} to {value:g}: nothing was written"
            )
        try:
            self._plant.write(written.node, value)
        finally:
            # After an error, too: the value may have arrived, at the latest now.
            self._known[knob.name] = _Known(value, self._clock(), known.value)


SLACK = 10
"""Additional periods that a plant may take to show a written value."""
_STEPS = 20
"""Number of steps in a row without progress after which a person must help."""
_PATIENCE = 10.0
"""Seconds without progress, or without a connection, that are waited for at least once the process
was told to end; the old values are then restored at the next start."""


@dataclass(slots=True)
class Way:
    """Way of a plant back to its old values, as mutable state.

    Args:
        written: Nodes that may be written to, by name.
        targets: Old values by name.
        period: Sampling period of the run, in seconds.
        since: Time of the latest progress, in seconds; at first, of the beginning.
    """

    written: Mapping[str, LiveKnob]
    targets: Mapping[str, float]
    period: float
    since: float
    _steps: int = 0
    _left: dict[str, float] = field(default_factory=dict)
    _waiting: float = field(init=False)

    def __post_init__(self) -> None:
        self._waiting = self.since

    def went(self, values: Mapping[str, float], now: float) -> None:
        """Take note of a step at time `now`, and of the values that the plant showed before it.

        Progress is that a value is closer to its target than ever before, so that two stations
        that write in turn make none.
        """
        self._steps += 1
        for name, target in self.targets.items():
            left, least = abs(values.get(name, inf) - target), self._left.get(name, inf)
            span = self.written[name].knob.high - self.written[name].knob.low
            if left < least - 1e-9 * span:  # never true of NaN
                self._left[name] = left
                self._steps, self.since, self._waiting = 0, now, now

    def lost(self, now: float) -> None:
        """Take note that the connection is lost, which only counts once the process must end."""
        self._steps, self.since = 0, now

    def blocked(self, now: float, *, closing: bool) -> bool:
        """Return whether there was no progress for so long that a person must help."""
        self._waiting = self._waiting if closing else now
        patience = _PATIENCE + SLACK * self.period + self._slowest()
        stuck = self._steps >= _STEPS and now - self.since > patience
        return stuck or (closing and now - self._waiting > _PATIENCE + self._slowest())

    def _slowest(self) -> float:
        """Return the longest time in seconds between two steps: integers cannot move by less."""
        rates = [self.written[n].rate for n in self.targets if self.written[n].knob.integer]
        return max((1.0 / rate for rate in rates), default=0.0)
