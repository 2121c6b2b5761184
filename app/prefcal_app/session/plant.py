"""Hold what an interview knows of a plant on which each run must be confirmed."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from prefcal_env.sources.run import Change, LiveCurve, Progress, Run
from prefcal_env.sources.source import Source

Attempt = Callable[[], Callable[[], None]]
"""Long-running function, called without the lock; it returns a function to call with the lock."""


class Recovery(Enum):
    """Whether the plant has its old values again, which an interrupted run may have changed."""

    DUE = "due"
    RUNNING = "running"
    FAILED = "failed"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class LiveNow:
    """What a front end shows of a plant on which each run must be confirmed.

    Args:
        changes: What a run would write, for the person to confirm; None while it is not known.
        problem: Why it is not known, or what remains to be done on the plant; empty if all is well.
        progress: How far the run is; None if none is in progress.
        times: Instants recorded so far, in seconds.
        curves: Outputs recorded so far.
        stopping: Whether the run was told to stop.
        recovery: Whether the plant has its old values again. If that failed, `problem` says why,
            and nothing is written until it succeeds.
    """

    changes: tuple[Change, ...] | None
    problem: str
    progress: Progress | None
    times: tuple[float, ...]
    curves: tuple[LiveCurve, ...]
    stopping: bool
    recovery: Recovery = Recovery.DONE


class PlantCare:
    """What must be done on a plant before anything else: restore what an interrupted run left.

    Args:
        source: Source of the scenario.

    Attributes:
        recovery: Whether that is done. Nothing is read or written for a new run before it is.
        problem: What remains to be done on the plant, as a sentence; empty if nothing does.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.recovery = Recovery.DUE if source.recovers else Recovery.DONE
        self.problem = ""
        self.run: Run | None = None

    def is_due(self, problem: str = "") -> None:
        """Let the old values be restored next; `problem` says why they are not."""
        if self._source.recovers:
            self.recovery, self.problem = Recovery.DUE, problem

    def recover(self, changed: Callable[[], None], tell: Callable[[], None]) -> Attempt:
        """Return the work that restores the old values.

        Args:
            changed: Function that is called when there is news, from the thread of the work.
            tell: Function that is called, with the lock, once the work is done.
        """
        self.recovery, self.run = Recovery.RUNNING, self._source.recovery()
        run, run.changed = self.run, changed

        def restore() -> Callable[[], None]:
            problem = ""
            try:
                run.advance()
            except Exception as error:  # whatever it is, the old values may be missing
                problem = str(error) or type(error).__name__

            def done() -> None:
                self.problem, self.run = problem, None
                self.recovery = Recovery.FAILED if problem else Recovery.DONE
                tell()

            return done

        return restore

    def now(self, run: Run | None) -> LiveNow:
        """Return what a front end shows of a live plant, given the run of the pending sample."""
        shown = self.run or run
        times, curves = ((), ()) if shown is None else shown.recorded
        return LiveNow(
            changes=None if run is None else run.changes,
            problem=self.problem or ("" if run is None else run.problem),
            progress=None if shown is None else shown.progress,
            times=times,
            curves=curves,
            stopping=False if shown is None else shown.stopping,
            recovery=self.recovery,
        )
