"""Move the run of a scenario into worker processes that load the user's file."""

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from queue import SimpleQueue

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RunError, SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.live import LiveRig
from prefcal_env.rig import Rig
from prefcal_env.study.codec import decode
from prefcal_env.workers import GRACE, Terms, Worker
from prefcal_scenarios.names import is_own
from prefcal_scenarios.scenario import Scenario

from .own_run import OwnRun, ranges_of, work_of

DEFAULT_LIMIT = 3600.0
"""Default time limit of a run in seconds, longer than most simulations."""


@dataclass(frozen=True, slots=True)
class IsolatedRun:
    """A run of θ in the process of a worker, where it is known by the key of θ.

    Args:
        source: Source of the scenario, path/to/own.py:NAME.
        workers: Workers that run θ, one each at the same time.
        space: Ranges of the study, if they were changed; those of the scenario if None.
    """

    source: str
    workers: tuple[Worker, ...]
    space: KnobSpace | None = None
    _idle: SimpleQueue[Worker] = field(default_factory=SimpleQueue, compare=False)

    def __post_init__(self) -> None:
        for worker in self.workers if self._idle.empty() else ():
            self._idle.put(worker)

    @property
    def worker(self) -> Worker:
        """Return the first worker, which is the only one unless several θ run at once."""
        return self.workers[0]

    @property
    def elsewhere(self) -> OwnRun:
        """Return the same run for the workers of a pool."""
        return OwnRun(self.source, ranges_of(self.space))

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,). Raises RunError if there is no experiment."""
        alone = len(self.workers) == 1  # then it may wait for a run that is being ended
        worker = self.worker if alone else self._idle.get()
        try:
            request = theta, seed, ranges_of(self.space)
            return decode(worker.run(request, theta_key(theta)))
        except RunError:
            worker.start()  # so that it loads the file while people read
            raise
        finally:
            if not alone:
                self._idle.put(worker)

    def within(self, space: KnobSpace) -> "IsolatedRun":
        """Return the same run with the ranges of `space`."""
        return replace(self, space=space)


@contextmanager
def isolation(
    source: str, limit: float = DEFAULT_LIMIT, *, early: bool = True, at_once: int = 1
) -> Iterator[Callable[[Scenario], Scenario]]:
    """Yield a function that moves the runs of a scenario into a separate process.

    Built-in scenarios, which always end, are only moved if several experiments run at once. Rigs,
    which a person runs, are never moved.

    Args:
        source: Name of the scenario, or path/to/own.py:NAME.
        limit: Maximum number of seconds of a run; infinite for no limit.
        early: Whether the process starts at once, to load the file while prefcal does, or only
            when needed.
        at_once: Number of processes, for as many experiments at the same time. Then a run whose
            process dies is tried once more: it may have been killed from outside.

    Raises:
        SettingsError: If the limit is not above 0.
    """
    if not limit > 0:
        raise SettingsError(f"--run-timeout must be above 0 s, got {limit:g}")
    if not is_own(source) and at_once == 1:
        yield lambda scenario: scenario
        return
    work = pickle.dumps((work_of, (source, limit)))
    terms = Terms(allows="--run-timeout", again=at_once > 1, grace=GRACE, threads=None)
    workers = tuple(Worker(lambda: work, limit, terms) for _ in range(at_once))

    def isolated(scenario: Scenario) -> Scenario:
        if isinstance(scenario.run, Rig | LiveRig):
            if at_once > 1:
                raise SettingsError("a rig runs one experiment at a time: leave --at-once out")
            workers[0].close(gently=True)
            return scenario
        return replace(scenario, run=IsolatedRun(source, workers))

    for worker in workers if early else ():
        worker.start()
    try:
        yield isolated
    finally:
        for worker in workers:
            worker.close(gently=True)
