"""Start, use and end one worker process, with everything that its code started."""

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, Queue
from typing import IO, final

from .inside import Kind, Message, receive, send

GRACE = 2.0
"""Seconds for the user's code to stop its plant (finally, with) before it is killed."""
_LAST_WORDS = 0.2
"""Seconds for reading the last messages of an ended process."""
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables from which libraries of linear algebra read their number of threads."""
_POLITE = 10
"""How much lower the priority of a gentle process is (its niceness)."""
_BOOT = (
    "import json, os, sys; path, args, nice = json.loads(sys.argv[1]); "
    "nice and hasattr(os, 'nice') and os.nice(nice); "
    "sys.path[:] = path; from prefcal_env.workers.inside import main; main(*args)"
)


@dataclass(frozen=True, slots=True)
class Terms:
    """On what terms a worker process runs requests.

    Args:
        what: What a request is, for messages.
        allows: Option that allows more time, for messages; empty for none.
        again: Whether a request whose process died runs once more; not what moves a real plant.
        grace: Seconds for the code of a request to clean up when it is ended; 0 to kill at once.
        gentle: Whether it works behind a person's back: it leaves the processor to whatever they
            wait for, and in a pool its time limit follows the usual time of a request.
        threads: Number of threads of linear algebra; None for as many as in this process.
        quiet: Whether what it prints is kept from people, but for the last line before a crash.
    """

    what: str = "the run"
    allows: str = ""
    again: bool = True
    grace: float = 0.0
    gentle: bool = False
    threads: int | None = 1
    quiet: bool = False


@final
class Process:
    """A process from its start to its end; `loaded` says whether it can run requests.

    Args:
        work: Pickled function, and its arguments, that return the function of each request.
        period: Seconds after which results are sent; 0 to send each at once.
        terms: On what terms it runs.
        bell: Event that is set when there is something to `hear`.
    """

    def __init__(self, work: bytes, period: float, terms: Terms, bell: threading.Event) -> None:
        limited = {} if terms.threads is None else dict.fromkeys(_THREADS, str(terms.threads))
        arguments = [sys.path, [period, terms.grace > 0], _POLITE if terms.gentle else 0]
        self._said: IO[bytes] | None = tempfile.TemporaryFile() if terms.quiet else None  # noqa: SIM115
        # In its own process group, it gets no Ctrl-C from the terminal and ends with its children.
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BOOT, json.dumps(arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            start_new_session=os.name == "posix",
            env=os.environ | limited,
        )
        self.pid, self.owner, self.loaded = self._process.pid, os.getpid(), False
        self._grace, self._bell = terms.grace, bell
        self._inbox: Queue[Message] = Queue()
        self._silent = self._damaged = False
        self._thread = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._thread.start()
        self._send(work)

    def ask(self, requests: list[bytes]) -> None:
        """Send pickled requests; `hear` returns the answers."""
        self._send(pickle.dumps(requests))

    def hear(self) -> Message | None:
        """Return the next message; None if there is none yet."""
        with suppress(Empty):
            return self._inbox.get_nowait()
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
            return f"its process ended with exit code {code}{self._last_line()}"
        name = signal.Signals(-code).name
        hint = {"SIGKILL": " (out of memory?)", "SIGSEGV": " (a crash in compiled code)"}
        return f"its process was ended by {name}{self._last_line() or hint.get(name, '')}"

    def end(self) -> str:
        """End the process and its children, gently if there is time; return the line it was in.

        It is the last line of the user's own code, "own.py:12: x = 1 / 0", or empty.
        """
        try:
            if self._grace:
                self._process.terminate()
                self._process.wait(self._grace)
        except subprocess.TimeoutExpired:
            pass
        finally:
            self.kill()
        self._thread.join(_LAST_WORDS)
        while (message := self.hear()) is not None:
            self.loaded |= message[0] is Kind.READY  # nobody has heard it yet
            if message[0] is Kind.ERROR and self.loaded:
                return str(pickle.loads(message[1]))
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
        """End the process at once; in a fork of its owner, do nothing."""
        if self.owner != os.getpid():
            return
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
        else:
            self._process.kill()
        self._process.wait()
        if self._said is not None:
            self._said.close()

    def _send(self, content: bytes) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # it is gone: `hear` will say so
            send(self._process.stdin, Kind.REQUESTS, content)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with suppress(OSError), self._process.stdout as pipe:
            try:
                while (message := receive(pipe)) is not None:
                    self._inbox.put(message)
                    self._bell.set()
            except ValueError:  # a result could not be told from what the code wrote
                self._damaged = True
        self._silent = True
        self._bell.set()

    def _last_line(self) -> str:
        """Return the last line that a quiet process printed, in brackets."""
        if self._said is None:
            return ""
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").replace("\0", "").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f" ({last[-300:]})" if last else ""
