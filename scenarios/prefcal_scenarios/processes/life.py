"""Start, use and end one worker process, with everything that its code started."""

import json
import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from queue import Empty, Queue
from typing import final

from .messages import Kind, Message, receive, send

GRACE = 2.0
"""Seconds for the user's code to stop its plant (finally, with) before it is killed."""
_LAST_WORDS = 0.2
"""Seconds for reading the last messages of an ended process."""
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables from which libraries of linear algebra read their number of threads."""
_POLITE = 10
"""How much lower the priority of a gentle process is (its niceness)."""
_BOOT = (
    "import importlib, json, os, sys; module, path, args, nice = json.loads(sys.argv[1]); "
    "nice and hasattr(os, 'nice') and os.nice(nice); "
    "sys.path[:] = path; importlib.import_module(module).main(*args)"
)


@final
class Life:
    """A process from its start to its end; `loaded` says whether the user's code is loaded.

    Args:
        module: Name of the module whose `main` the process runs.
        args: Arguments of `main`, plain data.
        threads: Number of threads of linear algebra; None for as many as in this process.
        bell: Event that is set when there is something to `hear`.
        gentle: Whether it leaves the processor to whatever a person waits for.
    """

    def __init__(
        self,
        module: str,
        *args: str | float,
        threads: int | None = None,
        bell: threading.Event | None = None,
        gentle: bool = False,
    ) -> None:
        limited = {} if threads is None else dict.fromkeys(_THREADS, str(threads))
        nice = _POLITE if gentle else 0
        # In its own process group, it gets no Ctrl-C from the terminal and ends with its children.
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BOOT, json.dumps([module, sys.path, args, nice])],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=os.name == "posix",
            env=os.environ | limited,
        )  # fmt: skip
        self._inbox: Queue[Message | None] = Queue()
        self._bell = bell or threading.Event()
        self._silent = self._damaged = False
        self.loaded = False
        self._thread = threading.Thread(target=self._listen, name="own code", daemon=True)
        self._thread.start()

    def ask(self, request: bytes) -> None:
        """Send a request, for example a run of θ; `hear` returns the answer."""
        assert self._process.stdin is not None
        with suppress(OSError):  # it is gone: `hear` will say so
            send(self._process.stdin, Kind.RUN, request)

    def hear(self, seconds: float) -> Message | None:
        """Return the next message; None after a timeout, after `wake`, or if it is `gone`."""
        with suppress(Empty):
            return self._inbox.get(timeout=max(seconds, 0.0))
        return None

    @property
    def gone(self) -> bool:
        """Return whether the process has ended and all of its messages were read.

        The pipe alone cannot tell, since children of the user's code may hold it open.
        """
        if not self._silent and self._process.poll() is not None:
            self._thread.join(_LAST_WORDS)
            self._silent = True
        return self._silent and self._inbox.empty()

    def wake(self) -> None:
        """Let `hear` return."""
        self._inbox.put(None)
        self._bell.set()

    def ended(self) -> str:
        """Wait for the process to end, and return how it ended."""
        if self._damaged:
            return "its code used a file that it had not opened, and so disturbed prefcal"
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(GRACE)
        code = self._process.poll()
        if code is None:
            return "its process no longer answers"
        if code >= 0:
            return f"its process ended with exit code {code}"
        name = signal.Signals(-code).name
        hint = {"SIGKILL": " (out of memory?)", "SIGSEGV": " (a crash in compiled code)"}
        return f"its process was ended by {name}{hint.get(name, '')}"

    def end(self) -> str:
        """End the process and its children, gently at first; return the user's line it was in."""
        try:
            self._process.terminate()
            self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            pass
        finally:
            self.kill()
        self._thread.join(_LAST_WORDS)
        while (message := self.hear(0.0)) is not None or not self._inbox.empty():
            if message is not None and message[0] is Kind.ERROR:
                return str(json.loads(message[1])["line"])
        return ""

    def dismiss(self) -> None:
        """Tell the process that there is nothing more to run, so that it ends."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()

    def leave(self) -> None:
        """End the process while nothing runs; the user's code can clean up at exit."""
        try:
            self.dismiss()
            self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            pass
        finally:
            self.kill()

    def kill(self) -> None:
        """End the process at once."""
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        else:
            self._process.kill()
        self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with suppress(OSError), self._process.stdout as pipe:
            try:
                while (message := receive(pipe)) is not None:
                    self._inbox.put(message)
                    self._bell.set()
            except ValueError:  # a run of an unknown θ could not be told from one of this
                self._damaged = True
        self._silent = True
        self.wake()
