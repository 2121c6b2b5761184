"""Let many pages wait for the next change of an interview, on one thread."""

import asyncio
import threading
from contextlib import suppress
from dataclasses import dataclass

from prefcal_app.session import Interview

_ROUND = 1.0
"""Seconds after which the thread checks whether any page is still waiting."""
_PAUSE = 0.05
"""Seconds between rounds without a change, since a closed interview returns at once."""


@dataclass(frozen=True, slots=True, eq=False)
class _Waiter:
    loop: asyncio.AbstractEventLoop
    future: asyncio.Future[None]
    version: int

    def wake(self) -> None:
        """End the wait; can be called from any thread."""
        # RuntimeError: the loop is already closed, so nothing is waiting.
        with suppress(RuntimeError):
            self.loop.call_soon_threadsafe(self._done)

    def _done(self) -> None:
        if not self.future.done():
            self.future.set_result(None)


class Watch:
    """A watcher that wakes every page that waits for a change.

    One thread waits for all open tabs, so the server's threads stay free for answers.

    Args:
        interview: Interview to watch.
    """

    def __init__(self, interview: Interview) -> None:
        self._interview = interview
        self._lock = threading.Lock()
        self._waiters: set[_Waiter] = set()
        self._running = False
        self._stopping = threading.Event()

    async def changed(self, version: int, timeout: float) -> None:
        """Return when the version differs from `version`, or after `timeout` seconds."""
        loop = asyncio.get_running_loop()
        waiter = _Waiter(loop, loop.create_future(), version)
        self._enter(waiter)
        try:
            with suppress(TimeoutError):
                await asyncio.wait_for(waiter.future, timeout)
        finally:
            with self._lock:
                self._waiters.discard(waiter)

    @property
    def waiting(self) -> int:
        """Return the number of waiting pages."""
        with self._lock:
            return len(self._waiters)

    def wake(self) -> None:
        """Wake every page, even if the version is the same."""
        with self._lock:
            waiters = tuple(self._waiters)
        for waiter in waiters:
            waiter.wake()

    def stop(self) -> None:
        """Wake every page; from now on, no page waits."""
        self._stopping.set()
        self.wake()

    def _enter(self, waiter: _Waiter) -> None:
        with self._lock:
            self._waiters.add(waiter)
            start, self._running = not self._running, True
        if self._stopping.is_set():
            waiter.wake()
        if start:
            threading.Thread(target=self._loop, name="changes", daemon=True).start()

    def _loop(self) -> None:
        seen = self._interview.now().version
        while self._wake_late(seen):
            version = self._interview.wait(seen, _ROUND).version
            if version == seen:
                self._stopping.wait(_PAUSE)
            seen = version

    def _wake_late(self, version: int) -> bool:
        """Wake the pages with another version; return whether any page is left waiting."""
        with self._lock:
            late = [w for w in self._waiters if w.version != version]
            self._running = bool(self._waiters) and not self._stopping.is_set()
        for waiter in late:
            waiter.wake()
        return self._running
