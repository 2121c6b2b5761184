"""Simulate θ for an agent: each one once, in worker processes that leave the page its processor."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import not_
from typing import Self, final

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs.key import theta_key, theta_keys
from prefcal_env.preferences.kpis import Outcome
from prefcal_env.workers import Pool, Terms, usable_cores
from prefcal_scenarios import verification
from prefcal_scenarios.kpis import all_screened, has_goals, reading
from prefcal_scenarios.many.results import FailedRun, Result
from prefcal_scenarios.many.task import Task
from prefcal_scenarios.scenario import Scenario

from .kept import Kept

_TELL = 0.5
"""Seconds between two reports of progress."""
_MOST = 8
"""Largest number of workers unless more are asked for: each takes 100 to 200 MB."""
_ENDING = 1.0
"""Seconds to wait for an abandoned batch before its workers are killed."""

Theta = Float[np.ndarray, " n"]


class Abandoned(Exception):
    """A batch of simulations was given up, since its results are no longer needed."""


@final
class Simulator:
    """What an agent simulates with: `simulate(theta)`, and `many` for a list of θ.

    The results do not depend on the number of workers. A simulation that raises an error, crashes
    or takes too long has failed: it has no KPIs, and is not repeated. KPIs are
    `screened`.

    A scenario of prefcal itself, which always ends, also runs in this process until the first
    worker is ready, so that nobody waits for the workers.

    Args:
        scenario: Scenario with the knobs of the study.
        seed: Seed of every run.
        jobs: Number of workers; None for one for each core, but for a scenario of prefcal one
            less; 0 to run everything in this process.
        longest: Largest time limit of a simulation in seconds, in workers; infinite for none.
        kept: Results of earlier, which are not simulated again, and where new ones are kept.
        robust: Whether agents judge candidates by perturbed runs, too.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int = 0,
        jobs: int | None = None,
        longest: float = np.inf,
        kept: Kept | None = None,
        robust: bool = False,
    ) -> None:
        source = scenario.source.elsewhere
        own = source is not scenario.source
        self.scenario, self.reading = scenario, reading(scenario)
        directed = has_goals(scenario)
        run = verification.Perturbed(scenario, seed) if robust else source
        self.holds = partial(verification.runs_kept, self.many, self.reading) if robust else None
        self._task = Task(run, seed, trajectories=not directed)
        # They are gentle: the page has its processor even if there is a worker on each core. This
        # process runs built-in scenarios, too, until the first worker is ready.
        workers = min(usable_cores() if own else max(usable_cores() - 1, 1), _MOST)
        workers = workers if jobs is None else jobs
        self._pool = self._task.pool(workers, longest, Terms(gentle=True)) if workers else None
        self._helps = not own
        self._kept = kept
        self._known = {} if kept is None else dict(kept.known)
        self.count = sum(map(self._is_nominal, self._known))
        """Number of simulated θ."""
        self.failed = sum(not kpis for key, kpis in self._known.items() if self._is_nominal(key))
        """Number of simulations that failed."""
        self._batch = threading.Lock()  # held while a batch runs
        self._abandoned = False
        self._told_at = 0.0
        self.tell: Callable[[], None] = lambda: None
        """Function that is called during a batch, twice a second, when there is progress."""
        self.failure = ""
        """How the last simulation that failed did so; empty if none has."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def busy(self) -> bool:
        """Return whether a batch is being simulated."""
        return self._batch.locked()

    def start(self) -> None:
        """Start the workers, which then load the scenario while something else is done.

        Not if results are kept: there may be nothing left to simulate.
        """
        if self._pool is not None and not self._known:
            self._pool.start()

    def __call__(self, theta: Theta) -> Mapping[str, float]:
        """Return the KPIs of θ, physical, shape (n,), lower is better; none if it failed."""
        return self.many([theta])[0]

    def many(self, thetas: Sequence[Theta]) -> list[Outcome]:
        """Return the KPIs of each θ, in order.

        Raises:
            Abandoned: If `abandon` is called meanwhile. What is known by then stays known.
            ScenarioError: If the workers cannot load the scenario.
        """
        with self._batch:
            keys = theta_keys(np.array(thetas, dtype=float)) if len(thetas) else []
            new = {key: t for key, t in zip(keys, thetas, strict=True) if key not in self._known}
            if self._pool is None:
                self._here(list(new.values()))
            elif new:
                self._in(self._pool, new)
            return [self._known[key] for key in keys]

    def _is_nominal(self, key: bytes) -> bool:
        """Return whether a key is that of a θ, and not that of a perturbed run."""
        return len(key) == len(theta_key(np.zeros(len(self.scenario.space))))

    def resume(self) -> None:
        """Let batches run again after `abandon`."""
        self._abandoned = False

    def abandon(self) -> None:
        """Give up the batch that runs, and any that follows before `resume`, from any thread."""
        self._abandoned = True
        if self._pool is not None:
            self._pool.wake()

    def close(self) -> None:
        """End the workers; nothing can be simulated afterwards."""
        self.abandon()
        waited = self._batch.acquire(timeout=_ENDING)
        try:
            if self._pool is not None:
                self._pool.close()
            if self._kept is not None:
                self._kept.close()
        finally:
            if waited:
                self._batch.release()

    def _here(self, thetas: Sequence[Theta]) -> None:
        """Simulate θ in this process, and keep the results when progress is reported."""
        arrived: list[tuple[Theta, Result]] = []
        try:
            for theta in thetas:
                if self._progress_is_due():
                    self._keep(arrived)
                    arrived.clear()
                    self.tell()
                arrived.append((theta, self._task.here(theta)))
        finally:
            self._keep(arrived)

    def _in(self, pool: Pool, new: Mapping[bytes, Theta]) -> None:
        """Simulate `new` in the workers, and help them until the first is ready."""
        pool.give(list(new.values()))
        left = set(new)
        try:
            while left:
                if self._progress_is_due():
                    self.tell()
                mine = None if pool.loaded or not self._helps else pool.take_back()
                arrived = [] if mine is None else [(mine, self._task.here(mine))]
                arrived += [found[1:] for found in pool.collect(patient=mine is None)]
                left.difference_update(self._keep(arrived))
        finally:
            pool.drop()

    def _progress_is_due(self) -> bool:
        """Return whether progress is to be reported. Raises Abandoned if the batch is given up."""
        if self._abandoned:
            raise Abandoned
        now = time.monotonic()
        due = now - self._told_at >= _TELL
        self._told_at = now if due else self._told_at
        return due

    def _keep(self, arrived: Sequence[tuple[Theta, Result]]) -> list[bytes]:
        """Keep the KPIs of θ with their results, and return the keys of these θ."""
        if not arrived:
            return []
        keys = theta_keys(np.array([theta for theta, _ in arrived], dtype=float))
        known = all_screened(self.scenario, [result for _, result in arrived])
        self._known.update(zip(keys, known, strict=True))
        if self._is_nominal(keys[0]):
            self.count += len(keys)
            self.failed += sum(map(not_, known))
        for (theta, result), kpis in zip(arrived, known, strict=True):
            again = False
            if isinstance(result, FailedRun):
                self.failure = result.words
                # A run that took too long, or whose process ended, may succeed another time.
                again = result.why != "raised"
            if self._kept is not None and not again:
                self._kept.add(theta, kpis)
        return keys
