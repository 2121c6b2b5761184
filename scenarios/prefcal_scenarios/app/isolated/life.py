"""One life of the process of own code: started, spoken to, and ended with all that it started."""

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
"""Seconds in which own code can put its plant at rest (finally, with) before it is killed."""
_LAST_WORDS = 0.2
"""Seconds in which what an ended process has said is read."""
_BOOT = (
    "import json, sys; told = json.loads(sys.argv[1]); sys.path[:] = told['path']; "
    "from prefcal_scenarios.app.isolated.inside import main; main(told['source'], told['limit'])"
)


@final
class Life:
    """A process from its start to its end; `loaded` says that the user's file is.

    Args:
        source: Of the scenario, path/to/own.py:NAME.
        limit: Most seconds of a run.
    """

    def __init__(self, source: str, limit: float) -> None:
        told = json.dumps({"path": sys.path, "source": source, "limit": limit})
        # A group of its own: Ctrl-C in the terminal is not for it, and its children go with it.
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BOOT, told],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=os.name == "posix",
        )  # fmt: skip
        self._inbox: Queue[Message | None] = Queue()
        self._silent = False
        self.loaded = False
        self._thread = threading.Thread(target=self._listen, name="own code", daemon=True)
        self._thread.start()

    def ask(self, request: bytes) -> None:
        """Have a θ run; the answer comes by `hear`."""
        assert self._process.stdin is not None
        with suppress(OSError):  # it is gone: `hear` will say so
            send(self._process.stdin, Kind.RUN, request)

    def hear(self, seconds: float) -> Message | None:
        """Return the next message; None after so many seconds, if `wake` was called, or `gone`."""
        with suppress(Empty):
            return self._inbox.get(timeout=max(seconds, 0.0))
        return None

    @property
    def gone(self) -> bool:
        """Whether the process has ended, and all that it said is heard.

        Children of own code may hold its pipe open, so the pipe alone does not tell.
        """
        if not self._silent and self._process.poll() is not None:
            self._thread.join(_LAST_WORDS)
            self._silent = True
        return self._silent and self._inbox.empty()

    def wake(self) -> None:
        """Let `hear` return."""
        self._inbox.put(None)

    def ended(self) -> str:
        """Wait until the process is gone, and say how it ended."""
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
        """End the process, first kindly, and whatever it has started; the own line it was in."""
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

    def leave(self) -> None:
        """End the process while nothing runs: own code may tidy up at its exit."""
        assert self._process.stdin is not None
        try:
            with suppress(OSError):
                self._process.stdin.close()
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
        with suppress(OSError, ValueError), self._process.stdout as pipe:
            while (message := receive(pipe)) is not None:
                self._inbox.put(message)
        self._silent = True
        self.wake()
