"""Hold a flow behind one lock, since pages, terminals and workers use it from several threads."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from . import runs
from .flow import Flow


class Guarded:
    """A flow with its lock, which also tells of changes.

    Args:
        flow: Flow of the interview.

    Attributes:
        changed: Lock; it is notified of each change.
        closing: Whether no more work is taken.
        has_background: Whether threads take work in the background.
    """

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self.changed = threading.Condition(threading.RLock())
        self.closing = self.has_background = False
        flow.underway.changed = self.tell

    @contextmanager
    def reading(self) -> Iterator[Flow]:
        """Hold the lock while the flow is read."""
        with self.changed:
            yield self._flow

    @contextmanager
    def changing(self) -> Iterator[Flow]:
        """Hold the lock while the flow is changed, and tell of it afterward."""
        with self.changed:
            version = self._flow.version
            try:
                yield self._flow
            finally:
                if self._flow.version != version:
                    runs.make_way(self._flow)
                    self.changed.notify_all()

    def tell(self) -> None:
        """Tell front ends that there is news, such as of a run in progress."""
        with self.changing() as flow:
            flow.tell_change()
