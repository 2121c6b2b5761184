"""Whether a page is open, told from when pages ask."""

import time
from collections.abc import Callable

_HIDDEN = 70.0
"""Seconds that a page in a hidden tab may be silent: browsers wake such a page once a minute."""


class Presence:
    """Knows how long no page has been open.

    Args:
        clock: Seconds that never run backwards.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until: float | None = None

    def seen(self, waits: bool) -> None:
        """Note that a page asks how things stand, or that its wait has ended.

        Args:
            waits: Whether it wants to be told of the next change. A page in a hidden tab does not:
                it only comes back from time to time.
        """
        self._until = self._clock() + (0.0 if waits else _HIDDEN)

    def away(self) -> float | None:
        """Return for how many seconds no page has been open; None before the first page."""
        return None if self._until is None else max(0.0, self._clock() - self._until)
