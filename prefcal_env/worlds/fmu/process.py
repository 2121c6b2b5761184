"""Run an FMU in a worker process: it may hang or crash, and the next run goes on."""

import os
import pickle
import shutil
import tempfile
import threading
import time
import weakref
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any, final

from prefcal_env.errors import PlantError, RunError
from prefcal_env.workers import Terms, Worker

from .simulation import FMUSimulation, Job, Reply

_RUNS = 1_000
"""Number of runs after which the process is replaced, so that FMUs that leak stay small."""
_TERMS = Terms("the simulation", "timeout", threads=None, quiet=True)
_PREFIX = "prefcal-fmu-"
_OLD = 24 * 3600.0
"""Seconds after which the folder of a process that is gone is removed: a process of a container
can look as if it were."""


@final
class FMUProcess:
    """A process that simulates an FMU; it starts with the first run and is kept for the next.

    Args:
        job: What to simulate.
        limit: Time limit of a run in seconds; infinite for none.
    """

    def __init__(self, job: Job, limit: float) -> None:
        self._given = job, limit
        self._lock = threading.Lock()
        self._started = _Started(job)
        self._worker = Worker(self._started.work, limit, _TERMS)
        self._resets = True  # whether a reset of the FMU may be tried
        weakref.finalize(self, _release, self._worker, self._started)

    @property
    def pid(self) -> int | None:
        """Return the id of the process; None before the first run and after a failed one."""
        return self._worker.pid

    def run(self, theta: list[float]) -> Reply:
        """Simulate θ, one value for each knob of the job. May be called from any thread.

        Raises:
            RunError: If the FMU cannot be started, takes too long, or ends the process.
            PlantError: If the file is no longer there.
        """
        with self._lock:
            started = self._started
            if started.runs == 1 and self._resets and self.pid is not None:
                started.runs += 1
                self._resets = self._bears_reset()
            if started.runs > _RUNS:
                self._worker.release()
            answer: Reply = self._worker.run(theta)
            started.runs += 1
            return answer

    def close(self) -> None:
        """End the process and remove its files; a further run starts anew."""
        with self._lock:
            _release(self._worker, self._started)

    def __reduce__(self) -> tuple[Any, ...]:  # a copy starts a process of its own
        return type(self), self._given

    def _bears_reset(self) -> bool:
        """Return whether the process goes on after a reset was tried, whatever came of it."""
        try:
            return bool(self._worker.run(None))
        except RunError:
            return False


class _Started:
    """What starts each process: the files of the FMU, which are unpacked when they are needed.

    Args:
        job: What to simulate.

    Attributes:
        home: Folder of the files; None if they are not unpacked.
        owner: Process whose files they are: this may be a fork.
        runs: Number of runs of the present process.
    """

    def __init__(self, job: Job) -> None:
        self._job, self.owner, self.runs = job, os.getpid(), 0
        self.home: Path | None = None

    def work(self) -> bytes:
        """Return the work of a new process."""
        if self.home is None or not self.home.exists() or self.owner != os.getpid():
            # Computers tidy their temporary folders, and a study may take weeks.
            self.home = unpacked(Path(self._job.path))
        self.owner, self.runs = os.getpid(), 0
        return pickle.dumps((FMUSimulation, (self._job._replace(path=str(self.home / "fmu")),)))


def _release(worker: Worker, started: _Started) -> None:
    """End the process, and remove its files, unless this is a fork of their owner."""
    if started.owner != os.getpid():
        return
    worker.release()
    if started.home is not None:
        shutil.rmtree(started.home, ignore_errors=True)
        started.home = None


def unpacked(path: Path) -> Path:
    """Return a new folder, with the contents of the FMU in its folder "fmu".

    Raises:
        PlantError: If it cannot be unpacked.
    """
    _remove_leftovers()
    home = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-"))
    try:
        with zipfile.ZipFile(path) as content:
            content.extractall(home / "fmu")
    except BaseException as error:  # Ctrl-C, too
        shutil.rmtree(home, ignore_errors=True)
        if not isinstance(error, OSError | zipfile.BadZipFile):
            raise
        raise PlantError(f"cannot unpack the FMU {str(path)!r}: {error}") from error
    return home


def _remove_leftovers() -> None:
    """Remove old folders of ours whose process was killed before it could remove them."""
    if os.name != "posix":
        return
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*-*"):
        with suppress(OSError, ValueError):
            found = folder.lstat()
            mine = found.st_uid == os.getuid() and time.time() - found.st_mtime > _OLD
            if mine and not _runs(int(folder.name.removeprefix(_PREFIX).partition("-")[0])):
                shutil.rmtree(folder, ignore_errors=True)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
