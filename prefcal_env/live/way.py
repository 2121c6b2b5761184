"""Notice when a plant comes no closer to its old values, so that restoring them has an end."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf

from .parts import Written

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

    written: Mapping[str, Written]
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
            span = self.written[name].high - self.written[name].low
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
        rates = [self.written[n].rate for n in self.targets if self.written[n].integer]
        return max((1.0 / rate for rate in rates), default=0.0)
