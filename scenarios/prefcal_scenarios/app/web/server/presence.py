"""Tell whether a page is open, from the times of its requests."""

import time
from collections.abc import Callable

_HIDDEN = 70.0
"""Seconds that a page in a hidden tab may be silent; browsers wake it once a minute."""


class Presence:
    """A record of when a page was last open.

    Args:
        clock: Monotonic clock, in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until: float | None = None

    def seen(self, waits: bool) -> None:
        """Note that a page asked for the current state, or that its wait ended.

        Args:
            waits: Whether the page waits for the next change. A page in a hidden tab does not; it
                only asks from time to time.
        """
        self._until = self._clock() + (0.0 if waits else _HIDDEN)

    def away(self) -> float | None:
        """Return the seconds since a page was last open; None before the first page."""
        return None if self._until is None else max(0.0, self._clock() - self._until)
