"""Let many pages wait for the next change of an interview, on one thread."""

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from prefcal_app.session import Interview

_ROUND = 1.0
"""Seconds after which the thread checks whether any page is still waiting."""
_PAUSE = 0.05
"""Seconds between rounds without a change, since a closed interview returns at once."""


class Watch:
    """A watcher that wakes every page that waits for a change.

    One thread waits for all open tabs, so the server's threads stay free for answers.

    Args:
        interview: Interview to watch.
    """

    def __init__(self, interview: Interview) -> None:
        self._interview = interview
        self._lock = threading.Lock()
        self._waiters: dict[asyncio.Future[None], tuple[int, Callable[[], object]]] = {}
        self._running = False
        self._stopping = threading.Event()

    async def changed(self, version: int, timeout: float) -> None:
        """Return when the version differs from `version`, or after `timeout` seconds."""
        loop = asyncio.get_running_loop()
        future = loop.create_future()
        with self._lock:
            if self._stopping.is_set():
                return
            self._waiters[future] = version, partial(loop.call_soon_threadsafe, _end, future)
            start, self._running = not self._running, True
        if start:
            threading.Thread(target=self._loop, name="changes", daemon=True).start()
        try:
            with suppress(TimeoutError):
                await asyncio.wait_for(future, timeout)
        finally:
            with self._lock:
                self._waiters.pop(future, None)

    @property
    def waiting(self) -> int:
        """Return the number of waiting pages."""
        with self._lock:
            return len(self._waiters)

    def wake(self, version: int | None = None) -> None:
        """Wake every page that waits for another version than `version`; all if None."""
        with self._lock:
            waiters = list(self._waiters.values())
        for waits, wake in waiters:
            if waits != version:
                with suppress(RuntimeError):  # its loop is closed, so nothing is waiting
                    wake()

    def stop(self) -> None:
        """Wake every page; from now on, no page waits."""
        with self._lock:
            self._stopping.set()
        self.wake()

    def _loop(self) -> None:
        seen = self._interview.now().version
        while True:
            self.wake(seen)
            with self._lock:
                self._running = bool(self._waiters) and not self._stopping.is_set()
                if not self._running:
                    return
            version = self._interview.wait(seen, _ROUND).version
            if version == seen:
                self._stopping.wait(_PAUSE)
            seen = version


def _end(future: "asyncio.Future[None]") -> None:
    if not future.done():
        future.set_result(None)
