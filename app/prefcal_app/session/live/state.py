"""Hold what an interview knows of its live plant."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.live import Change, Progress, Stage


class Recovery(Enum):
    """Whether the plant has its old values again, which an interrupted run may have changed."""

    DUE = "due"
    RUNNING = "running"
    FAILED = "failed"
    DONE = "done"


_DRAWN = 400
"""Largest number of samples that a live curve shows."""
Sample = tuple[float, Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class LiveNow:
    """What a front end shows of a live plant.

    Args:
        changes: What a run would write, for the person to confirm; None while it is not known.
        problem: Why it is not known, or what remains to be done on the plant; empty if all is well.
        progress: How far the run is; None if none is in progress.
        curve: Recorded samples so far: time in seconds and values by key.
        stopping: Whether the run was told to stop.
        recovery: Whether the plant has its old values again. If that failed, `problem` says why,
            and nothing is written until it succeeds.
    """

    changes: tuple[Change, ...] | None
    problem: str
    progress: Progress | None
    curve: tuple[Sample, ...]
    stopping: bool
    recovery: Recovery = Recovery.DONE


@dataclass(slots=True)
class Live:
    """Mutable part of an interview that concerns its live plant.

    Args:
        changed: Function that tells front ends that there is news.
    """

    changed: Callable[[], None] = lambda: None
    changes: tuple[Change, ...] | None = None
    problem: str = ""
    looked: bool = False
    """Whether the plant's values were asked for since the confirmation was asked for."""
    confirmed: int | None = None
    """Sample that the person confirmed; its run is in progress or about to start."""
    partial: Experiment | None = None
    """What a run recorded before it failed."""
    recovery: Recovery = Recovery.DUE
    """Nothing is read or written for a new run before it is done."""
    stop: threading.Event = field(default_factory=threading.Event)
    closing: threading.Event = field(default_factory=threading.Event)
    _progress: Progress | None = None
    _curve: list[Sample] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def ask(self) -> None:
        """Ask for a confirmation anew: the plant's values must be read first."""
        self.changes, self.looked, self.confirmed = None, False, None

    def begin(self) -> None:
        """Begin a run."""
        self.stop.clear()
        self.problem, self.partial = "", None
        with self._lock:
            self._progress, self._curve = Progress(Stage.CONNECTING, 0.0, 0.0), []

    def end(self) -> None:
        """End a run: nothing is in progress any more."""
        self.confirmed = None
        with self._lock:
            self._progress = None

    def tell(self, progress: Progress) -> None:
        """Take note of how far a run is; called from its thread."""
        with self._lock:
            self._progress = progress
            if progress.stage is Stage.RECORDING:
                self._curve.append((progress.elapsed, progress.values))
        self.changed()

    def now(self) -> LiveNow:
        """Return what a front end shows."""
        with self._lock:
            thin = max(1, -(-len(self._curve) // _DRAWN))
            curve = tuple(self._curve[::thin])
            progress = self._progress
        return LiveNow(self.changes, self.problem, progress, curve, self.stop.is_set(), self.recovery)
