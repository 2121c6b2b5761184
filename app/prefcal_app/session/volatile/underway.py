"""Hold the runs of an interview: those in progress, and those that wait to begin."""

from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RunError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.sources import Run, Source
from prefcal_env.study import Suggested

from ..study.now import PlantNow, Recovery

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

    def recover(self, changed: Callable[[], None]) -> Attempt:
        """Return the work that restores the old values.

        Args:
            changed: Function that is called when there is news, from the thread of the work.
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

            return done

        return restore

    def now(self, run: Run | None) -> PlantNow:
        """Return what a front end shows of a live plant, given the run of the pending sample."""
        shown = self.run or run
        times, curves = ((), ()) if shown is None else shown.recorded
        return PlantNow(
            changes=None if run is None else run.changes,
            problem=self.problem or ("" if run is None else run.problem),
            progress=None if shown is None else shown.progress,
            times=times,
            curves=curves,
            stopping=False if shown is None else shown.stopping,
            recovery=self.recovery,
        )


class UnderWay:
    """Runs of a source, by the key of their θ; callers must hold the interview's lock.

    Args:
        source: What turns θ into experiments.
        seed: Seed of the study.

    Attributes:
        plant: What must be done on the plant before anything else.
        going: Runs in progress.
        waiting: Runs that have not begun, or that ask a person; they can be stopped already.
        partial: What runs that failed had recorded until then; dropped when they wait again.
        checked: Whether an experiment of this process was checked against its scenario.
        changed: Function that tells front ends, from any thread, that there is news of a run.
    """

    def __init__(self, source: Source, seed: int) -> None:
        self.source, self._seed = source, seed
        self.plant = PlantCare(source)
        self.going: dict[bytes, Run] = {}
        self.waiting: dict[bytes, Run] = {}
        self.partial: dict[bytes, Experiment] = {}
        self.checked = False
        self.changed: Callable[[], None] = lambda: None

    def of(self, sample: Suggested | None) -> Run | None:
        """Return the run of a sample; None unless it waits or is in progress."""
        key = b"" if sample is None else theta_key(sample.theta)
        return self.going.get(key) or self.waiting.get(key)

    @property
    def every(self) -> list[Run]:
        """Return all runs of θ; it takes no lock."""
        return [*self.going.values(), *self.waiting.values()]

    @property
    def moves_plant(self) -> bool:
        """Return whether a run changes a plant, or is about to; it takes no lock."""
        return any(run.moves_plant for run in self.every)

    def plant_now(self, sample: Suggested | None) -> PlantNow | None:
        """Return what a front end shows of a plant on which each run is confirmed; None without one."""
        return self.plant.now(self.of(sample)) if self.source.asks == "confirm" else None

    def wait_for(self, sample: Suggested, unfinished: Iterable[Suggested], *, anew: bool = False) -> None:
        """Let the run of a sample wait, so that it can be stopped from now on.

        Args:
            sample: Sample that is due next.
            unfinished: All samples without an experiment; other runs no longer wait.
            anew: Whether to make its run again, for example to read a plant's present values.
        """
        key = theta_key(sample.theta)
        self.forget(unfinished)
        self.partial.pop(key, None)
        if key not in self.going and (anew or key not in self.waiting):
            self.waiting[key] = self._made(np.array(sample.theta))

    def forget(self, unfinished: Iterable[Suggested]) -> None:
        """Let no run wait but those of `unfinished` samples: a stop is for the run that was due."""
        due = {theta_key(sample.theta) for sample in unfinished}
        self.waiting = {key: run for key, run in self.waiting.items() if key in due}

    def begin(self, theta: Float[np.ndarray, " n"]) -> Run:
        """Return the run of θ, physical, shape (n,), which is in progress from now on."""
        key = theta_key(theta)
        # Never in neither: whether a run moves the plant is read without a lock.
        self.going[key] = self.waiting.get(key) or self._made(theta)
        self.waiting.pop(key, None)
        return self.going[key]

    def _made(self, theta: Float[np.ndarray, " n"]) -> Run:
        run = self.source.begin(theta.copy(), seed=self._seed)
        run.changed = self.changed
        return run

    def stop(self, why: str) -> None:
        """Stop all runs, also the one that restores a plant."""
        for run in self.every:
            run.stop(why)
        if self.plant.run is not None:
            self.plant.run.stop(why)

    def end(self, theta: Float[np.ndarray, " n"], result: Experiment | Exception | None) -> None:
        """Take note that the run of θ is over or, without a result, asks something of a person."""
        key = theta_key(theta)
        if key not in self.going:  # the result was known before
            self.waiting.pop(key, None)
            return
        run = self.going.pop(key)
        if result is None:
            self.waiting[key] = run
            return
        if isinstance(result, Exception) and run.partial is not None:
            self.partial[key] = run.partial
        # After an error nobody knows how far the run came, but what it left on the disk tells.
        unknown = isinstance(result, Exception) and not isinstance(result, RunError)
        if run.moves_plant and (run.problem or unknown):
            self.plant.is_due(run.problem)
