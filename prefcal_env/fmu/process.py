"""Run an FMU in a process of its own: it may hang or crash, and the next run goes on."""

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import weakref
from contextlib import suppress
from pathlib import Path
from typing import Any, final

from prefcal_env.errors import RunError

from .serving import Answer, Job
from .unpacking import unpacked

_BOOT = (
    "import json, runpy, sys; path, file = json.loads(sys.argv[1]); sys.path[:] = path; "
    "runpy.run_path(file, run_name='__main__')"
)
_RUNS = 1_000
"""Number of runs after which the process is replaced, so that FMUs that leak stay small."""
_LOADING = 60.0
"""Minimum time limit in seconds for loading the FMU."""
_LEAVING = 2.0
"""Seconds for the process to end by itself."""


@final
class Process:
    """A process that simulates an FMU; it starts with the first run and is kept for the next.

    Not `multiprocessing`: that needs an `if __name__ == "__main__"` in people's scripts, and
    cannot start a process in a daemonic one. A run may be called from any thread.

    Args:
        job: What to simulate.
        limit: Time limit of a run in seconds; infinite for none.
    """

    def __init__(self, job: Job, limit: float) -> None:
        self._job, self._limit = job, limit
        self._lock = threading.Lock()
        self._reset = True  # whether a reset of the FMU may be tried
        self._held = _Held()
        weakref.finalize(self, _Held.release, self._held)

    @property
    def pid(self) -> int | None:
        """Return the id of the process; None before the first run and after a failed one."""
        return None if self._held.worker is None else self._held.worker.pid

    def run(self, theta: list[float]) -> Answer:
        """Simulate θ, one value for each knob of the job.

        Raises:
            RunError: If the FMU cannot be started, takes too long, or ends the process.
            PlantError: If the file is no longer there.
        """
        with self._lock:
            if self._held.owner != os.getpid():  # a fork: the process belongs to the parent
                self._held = _Held()
                weakref.finalize(self, _Held.release, self._held)
            used = self._ready()
            try:
                return self._run(theta)
            except RunError as error:
                if not used or error.why != "died":
                    raise
            # Not θ may have ended the process, but what earlier runs left behind in it.
            before, self._reset = self._reset, False
            try:
                return self._run(theta)
            except RunError:
                self._reset = before
                raise

    def close(self) -> None:
        """End the process and remove its files; a further run starts anew."""
        with self._lock:
            self._held.release()

    def _ready(self) -> bool:
        """Return whether a used process is ready; one that did not bear a reset is ended."""
        worker = self._held.worker
        if worker is None:
            return False
        try:
            worker.settle(self._limit)
        except BaseException as error:
            worker.kill()
            self._held.worker = None
            if not isinstance(error, RunError):
                raise
            self._reset = False
        return self._held.worker is not None

    def _run(self, theta: list[float]) -> Answer:
        worker = self._started()
        try:
            answer = worker.run(theta, self._limit)
        except BaseException:  # Ctrl-C, too: its answer would be taken for the next one's
            worker.kill()
            self._held.worker = None
            raise
        if worker.runs >= _RUNS:
            worker.leave()
            self._held.worker = None
        return answer

    def _started(self) -> "_Worker":
        held = self._held
        if held.home is None or (held.worker is None and not held.home.exists()):
            # Computers tidy their temporary folders, and a study may take weeks.
            held.home = unpacked(Path(self._job.path))
        if held.worker is None:
            worker = _Worker(held.home)
            try:
                worker.begin(self._job, self._reset, max(self._limit, _LOADING))
            except BaseException:
                worker.kill()
                raise
            held.worker = worker
        return held.worker


class _Held:
    """What must be released at the end: the process, and the folder of its files."""

    def __init__(self) -> None:
        self.worker: _Worker | None = None
        self.home: Path | None = None
        self.owner = os.getpid()

    def release(self) -> None:
        """End the process and remove the files, unless this is a fork of their owner."""
        worker, home = self.worker, self.home
        self.worker, self.home = None, None
        if self.owner != os.getpid():
            return
        if worker is not None:
            worker.leave()
        if home is not None:
            shutil.rmtree(home, ignore_errors=True)


class _Worker:
    """A process from its start to its end."""

    def __init__(self, home: Path) -> None:
        self._home, self._messages = home, home / "messages.txt"
        file = str(Path(__file__).with_name("serving.py"))
        with self._messages.open("ab") as messages:
            # In a session of its own it survives the end of prefcal, to remove its files.
            self._process = subprocess.Popen(
                [sys.executable, "-c", _BOOT, json.dumps([sys.path, file])],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=messages,
                start_new_session=os.name == "posix",
            )  # fmt: skip
        self.pid, self.runs = self._process.pid, 0

    def begin(self, job: Job, reset: bool, limit: float) -> None:
        """Load the FMU. Raises RunError if that fails."""
        plain = tuple(job._replace(path=str(self._home / "fmu"), reset=reset))
        problem = self._heard(limit, "loading the FMU", plain)
        if problem:
            raise RunError(str(problem), "raised")

    def run(self, theta: list[float], limit: float) -> Answer:
        """Simulate θ. Raises RunError if it takes too long, or ends the process."""
        self.runs += 1
        return Answer(*self._heard(limit, "the simulation", theta))

    def settle(self, limit: float) -> None:
        """Wait until the process is ready after a run. Raises RunError if that fails."""
        self._heard(limit, "a reset")

    def leave(self) -> None:
        """Let the process end by itself, and keep the files."""
        with suppress(OSError, subprocess.TimeoutExpired):
            self._send(None)
            self._process.wait(_LEAVING)
        self.kill()

    def kill(self) -> None:
        """End the process and what it started at once."""
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
        else:
            self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]

    def _heard(self, limit: float, what: str, *request: Any) -> Any:
        late = threading.Event()

        def end() -> None:
            late.set()
            self._process.kill()

        timer = threading.Timer(min(limit, threading.TIMEOUT_MAX), end)
        timer.daemon = True
        timer.start()
        try:
            for content in request:
                self._send(content)
            assert self._process.stdout is not None
            return pickle.load(self._process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            if late.is_set():
                raise RunError(
                    f"{what} took longer than {limit:g} s and was ended (timeout allows more)",
                    "late",
                ) from error
            raise RunError(
                f"{what} ended the process of the FMU: {self._end()} (if only some θ do, narrow "
                "the ranges of the knobs)", "died",
            ) from error  # fmt: skip
        finally:
            timer.cancel()

    def _send(self, content: Any) -> None:
        assert self._process.stdin is not None
        pickle.dump(content, self._process.stdin)
        self._process.stdin.flush()

    def _end(self) -> str:
        """Return how the process ended, and the last line that it wrote."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_LEAVING)
        code = self._process.poll()
        if code is None:
            return "it no longer answers"
        how = f"exit code {code}" if code >= 0 else signal.Signals(-code).name
        lines = self._messages.read_bytes().decode(errors="replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f"{how} ({last[-300:]})" if last else how
