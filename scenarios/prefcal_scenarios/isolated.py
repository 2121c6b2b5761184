"""Run a user's own scenario in worker processes, each of which loads the user's file itself."""

import faulthandler
import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RunError, SettingsError
from prefcal_env.experiments.experiment import Experiment, check_returned
from prefcal_env.knobs import KnobSpace
from prefcal_env.sources.source import KPIsOf, Run, Source
from prefcal_env.study import space_of
from prefcal_env.study.fold import decode, encode, knobs_as_dicts, within_as_dict
from prefcal_env.workers import GRACE, Terms, Worker

from .catalog import load
from .names import TABLES, is_own
from .own import files_of
from .scenario import Scenario, with_ranges

_BEYOND = 30.0  # seconds after the time limit when the process ends itself, in case prefcal is gone
_LONGEST = 1e6  # longest time limit in seconds that the process can watch itself

Ranges = dict[str, Any] | None  # ranges of a study as plain data; None for those of the scenario


class OwnSource(Source):
    """The source of a user's own scenario; when it is unpickled, the user's file is loaded."""

    def __init__(self, path: str, ranges: Ranges) -> None:
        self._path, self._ranges = path, ranges

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,), in this process."""
        return self.here.run(theta, seed=seed)

    @property
    def here(self) -> Source:
        """Return the user's source, loaded in this process."""
        return _loaded(self._path, self._ranges)

    def __reduce__(self) -> tuple[Any, ...]:
        return _loaded, (self._path, self._ranges)


def work_of(source: str, limit: float) -> Callable[[tuple[Any, int, Ranges]], bytes]:
    """Return, in a worker, what runs θ with a seed in ranges in `limit` seconds: an experiment's bytes."""
    name = source.partition("{")[0].strip()
    sys.argv = [name.rpartition(":")[0] or name]
    scenario = load(source)

    def run(request: tuple[Any, int, Ranges]) -> bytes:
        theta, seed, ranges = request
        if limit < _LONGEST:
            faulthandler.dump_traceback_later(limit + _BEYOND, exit=True)
        try:
            return encode(check_returned(_source_of(scenario, ranges).run(theta, seed=seed)))
        finally:
            faulthandler.cancel_dump_traceback_later()

    return run


def _loaded(path: str, ranges: Ranges) -> Source:
    return _source_of(load(path), ranges)


def _source_of(scenario: Scenario, ranges: Ranges) -> Source:
    """Return the source of the scenario, with the ranges of the study."""
    if ranges is None:
        return scenario.source
    by_now = space_of(ranges)
    within = dict(zip(by_now.names, by_now.within, strict=True))
    constraints = scenario.space.constraints
    return with_ranges(scenario, KnobSpace(by_now.knobs, constraints, within=within)).source


# --- Move the run of a scenario into worker processes that load the user's file.

DEFAULT_LIMIT = 3600.0  # default time limit of a run in seconds, longer than most simulations


class Isolated(Source):
    """A user's own source whose runs happen in worker processes, one each at the same time."""

    stops = True

    def __init__(
        self, own: Source, path: str, workers: Sequence[Worker], space: KnobSpace | None = None
    ) -> None:
        self._own, self._path, self._workers = own, path, tuple(workers)
        self._ranges: Ranges = None
        if space is not None:
            self._ranges = {"knobs": knobs_as_dicts(space), "within": within_as_dict(space)}
        self.channels, self.signals, self.controller = own.channels, own.signals, own.controller
        self.function, self.maneuvers, self.limit = own.function, own.maneuvers, workers[0].limit
        self._idle = SimpleQueue[Worker]()
        for worker in workers:
            self._idle.put(worker)

    def begin(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Run:
        """Return a run of θ, physical, shape (n,), which can be stopped from now on."""
        return _WorkerRun((theta, seed, self._ranges), self._workers, self._idle)

    def within(self, space: KnobSpace) -> "Isolated":
        """Return the same source with the ranges of `space`."""
        return Isolated(self._own, self._path, self._workers, space)

    def measured(self, kpis_of: KPIsOf) -> "Isolated":
        """Return this: the workers' own scenario has the KPIs already."""
        return self

    @property
    def elsewhere(self) -> Source:
        """Return the same source for the workers of a pool: each loads the user's file."""
        return OwnSource(self._path, self._ranges)

    @property
    def hangs(self) -> bool:
        """Return whether the last run had to be ended, so that the next one may hang, too."""
        return self._workers[0].hangs


class _WorkerRun(Run):
    """A run in a worker, which knows it by its name."""

    def __init__(
        self, request: tuple[Any, ...], workers: Sequence[Worker], idle: SimpleQueue[Worker]
    ) -> None:
        self._request, self._workers, self._idle = request, workers, idle
        self._name, self._why = object(), ""

    def advance(self) -> Experiment:
        """Run θ in a worker. Raises RunError if there is no experiment."""
        alone = len(self._workers) == 1  # then it may wait for a run that is being ended
        worker = self._workers[0] if alone else self._idle.get()
        try:
            return decode(worker.run(self._request, self._name, self._begin))
        except RunError:
            worker.start()  # so that it loads the file while people read
            raise
        finally:
            if not alone:
                self._idle.put(worker)

    def stop(self, why: str, within: float = 0.0) -> None:
        """Stop the run, also before it began."""
        self._why = why
        for worker in self._workers:
            if worker.busy_with(self._name):
                worker.stop(why, within)

    def _begin(self) -> None:
        """Raise RunError if the run was stopped while it waited for a worker."""
        if self._why:
            who = "you stopped the run" if self._why == "stopped" else "the run was given up"
            raise RunError(f"{who} before it began", self._why)


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
        if scenario.source.asks:
            if at_once > 1:
                raise SettingsError("a rig runs one experiment at a time: leave --at-once out")
            workers[0].close(gently=True)
            return scenario
        for worker in workers if late else ():
            worker.start()
        return replace(scenario, run=Isolated(scenario.source, source, workers))

    # A record is identified by this process alone, and kept; others at the same time would do the same work.
    late = early and any(path.suffix.lower() in TABLES for path in files_of(source))
    for worker in workers if early and not late else ():
        worker.start()
    try:
        yield isolated
    finally:
        for worker in workers:
            worker.close(gently=True)
