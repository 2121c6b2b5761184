"""What every worker process needs: pipes that its code cannot touch, and an end with prefcal."""

import io
import os
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO, final

from .messages import Kind, receive, send

_TIDYING = 1.0
"""Seconds for the interpreter to end after prefcal ended."""


@final
class Link:
    """The connection of a worker process to prefcal; prints are dropped until `ready`."""

    def __init__(self) -> None:
        given, self._out = _pipes()
        self._process = os.getpid()
        _volunteer()
        self.requests: SimpleQueue[bytes | None] = SimpleQueue()
        """Contents of the requests; None when prefcal closes the pipe."""
        threading.Thread(target=_listen, args=(given, self.requests), daemon=True).start()

    def ready(self) -> None:
        """Say that the code is loaded; from now on its prints go to standard error."""
        os.dup2(2, 1)
        if isinstance(sys.stdout, io.TextIOWrapper):  # the user's code may have replaced it
            sys.stdout.reconfigure(line_buffering=True)
        self.say(Kind.READY)

    def say(self, kind: Kind, content: bytes = b"") -> None:
        """Send a message to prefcal; if prefcal is gone, this process ends soon.

        A fork of this process, which the user's code forgot to end, ends here.
        """
        if os.getpid() != self._process:
            os._exit(0)
        with suppress(OSError):
            send(self._out, kind, content)


def _pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes for requests and answers, which the user's code can neither read nor write.

    Output of the file while loading is dropped, since prefcal loads the file too and prints it.
    """
    given, out = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    os.close(nothing)
    return given, out


def _volunteer() -> None:
    """Ask the system to end this process rather than prefcal if memory runs out."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def _listen(given: BinaryIO, requests: SimpleQueue[bytes | None]) -> None:
    """Pass on requests; end the process soon after prefcal is gone, whatever is running."""
    with suppress(ValueError, OSError):  # the user's code read from the pipe, or closed it
        while (message := receive(given)) is not None:
            requests.put(message[1])
    requests.put(None)
    time.sleep(_TIDYING)
    os._exit(1)
