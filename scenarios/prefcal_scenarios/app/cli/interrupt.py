"""Ctrl-C at any moment: say so at once, stop, keep what is there, never half of a file."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
_ALSO = ("SIGTERM", "SIGHUP")
"""Signals that end a program as Ctrl-C does: `kill`, and a terminal that was closed."""


class Interruption:
    """Notes a first Ctrl-C, and raises where that is allowed; a second one always raises.

    `on_press` is called at the first one, before anything else.
    """

    def __init__(self) -> None:
        self.pressed = False
        self.on_press: Callable[[], None] = lambda: None
        self._allowed = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        again, self.pressed = self.pressed, True
        if not again:
            with suppress(OSError):  # the terminal may be gone
                self.on_press()
        if again or self._allowed:
            raise KeyboardInterrupt

    def check(self) -> None:
        """Raise if a press was held back, or swallowed by a callback of compiled code."""
        if self.pressed:
            raise KeyboardInterrupt

    @contextmanager
    def allowed(self) -> Iterator[None]:
        """Let a press raise at once inside, an earlier one too; outside, work is finished first."""
        self.check()
        self._allowed = True
        try:
            yield
        finally:
            self._allowed = False


@contextmanager
def interruption(*, others: bool = False) -> Iterator[Interruption]:
    """Handle Ctrl-C inside; a thread that may not set handlers keeps Python's own behavior.

    Args:
        others: Whether `kill` and a closed terminal are handled likewise. Leave it out if processes
            are started, which would inherit that.
    """
    handler = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield handler
        return
    before = {signal.SIGINT: signal.signal(signal.SIGINT, handler)}
    for name in _ALSO if others else ():
        number = getattr(signal, name, None)  # Windows has not all of them
        # Only in place of the system's own: `nohup` wants a hang-up ignored.
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            before[number] = signal.signal(number, handler)
    try:
        yield handler
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
