"""Hold what an interview knows of a plant on which each run must be confirmed."""

from collections.abc import Callable

from prefcal_env.sources.run import Run
from prefcal_env.sources.source import Source

from ..study.now import LiveNow, Recovery

Attempt = Callable[[], Callable[[], None]]
"""Long-running function, called without the lock; it returns a function to call with the lock."""


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
