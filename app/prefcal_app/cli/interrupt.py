"""Handle Ctrl-C at any moment: acknowledge it, stop, and keep all results in whole files."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells."""
_ALSO = ("SIGTERM", "SIGHUP")
"""Signals that end a program like Ctrl-C does: `kill`, and closing the terminal."""


class Interruption:
    """Signal handler that remembers the first Ctrl-C, and raises at once on the second.

    The first one raises only where this is allowed, after calling `on_press`.
    """

    def __init__(self) -> None:
        self.pressed = False
        self.on_press: Callable[[], None] = lambda: None
        self._allowed = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        again, self.pressed = self.pressed, True
        if not again:
            with suppress(OSError):  # the terminal may be closed
                self.on_press()
        if again or self._allowed:
            raise KeyboardInterrupt

    def check(self) -> None:
        """Raise if a press was held back, or swallowed by a callback of compiled code."""
        if self.pressed:
            raise KeyboardInterrupt

    @contextmanager
    def allowed(self) -> Iterator[None]:
        """Let a press raise at once inside the block, including an earlier press held back."""
        self.check()
        self._allowed = True
        try:
            yield
        finally:
            self._allowed = False


@contextmanager
def interruption(*, others: bool = False) -> Iterator[Interruption]:
    """Handle Ctrl-C inside the block; threads that cannot set handlers keep Python's behavior.

    Args:
        others: Whether to handle `kill` and a closed terminal, too. Must be False if the block
            starts processes, which would inherit the handling.
    """
    handler = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield handler
        return
    before = {signal.SIGINT: signal.signal(signal.SIGINT, handler)}
    for name in _ALSO if others else ():
        number = getattr(signal, name, None)  # Windows lacks some of them
        # Replace only the default handler: `nohup` ignores SIGHUP on purpose.
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            before[number] = signal.signal(number, handler)
    try:
        yield handler
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
