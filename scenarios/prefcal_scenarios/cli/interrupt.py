"""Ctrl-C at any moment: stop the study, keep what is there, never half of a file."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interruption:
    """Notes a first Ctrl-C, and lets it through where that is allowed; a second one always."""

    def __init__(self) -> None:
        self.pressed = False
        self._allowed = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        again, self.pressed = self.pressed, True
        if again or self._allowed:
            raise KeyboardInterrupt

    def check(self) -> None:
        """Raise if a press was held back, or swallowed by a callback of compiled code."""
        if self.pressed:
            raise KeyboardInterrupt

    @contextmanager
    def allowed(self) -> Iterator[None]:
        """Inside, a press raises at once, an earlier one too; outside, work is finished."""
        self.check()
        self._allowed = True
        try:
            yield
        finally:
            self._allowed = False


@contextmanager
def interruption() -> Iterator[Interruption]:
    """Handle Ctrl-C inside; a thread that may not set handlers keeps Python's own behaviour."""
    handler = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield handler
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield handler
    finally:
        signal.signal(signal.SIGINT, before)
