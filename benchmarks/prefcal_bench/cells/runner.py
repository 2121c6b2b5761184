"""Run the missing cells of a suite, even if workers die."""

import time
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

from prefcal_bench.people import TASTES
from prefcal_bench.problems import problem
from prefcal_env.errors import RunError

from .cell import Result, digest
from .duels import Duel, play, rounds
from .engine import Processes, each
from .run import alone, run_cell
from .store import Store, Trouble
from .suite import Suite

T = TypeVar("T")


class Watcher(Protocol):
    """Display of progress."""

    def begin(self, what: str, total: int, done: int) -> None:
        """Start a phase with `total` items, of which `done` are there already."""

    def landed(self, what: str) -> None:
        """Count one more item as done."""

    def say(self, words: str) -> None:
        """Print a message for the user."""


@dataclass(frozen=True)
class SuiteResults:
    """Outcome of a suite.

    Args:
        results: Results of all cells, in canonical order.
        duels: Duels of the problems without a cost, in canonical order.
        trouble: Descriptions of duels that could not be played.
    """

    results: tuple[Result, ...]
    duels: tuple[Duel, ...]
    trouble: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[Result, ...]:
        """Return the results of the cells that failed."""
        return tuple(result for result in self.results if result.failure)

    @property
    def digest(self) -> str:
        """Return the digest of all results, which does not depend on where the suite ran."""
        return digest(self.results)


def run_suite(suite: Suite, store: Store, workers: Processes | None, watcher: Watcher) -> SuiteResults:
    """Run all cells of `suite` that have no result in `store` or failed.

    Every result is stored when it completes, so an interruption loses only running cells.

    Raises:
        BenchmarkError: If the folder or the workers can no longer be used.
    """
    _prepare(suite, store, workers, watcher)
    results = _cells(suite, store, workers, watcher)
    duels, trouble = _duels(results, store, workers, watcher)
    return SuiteResults(results, duels, trouble)


def _prepare(suite: Suite, store: Store, workers: Processes | None, watcher: Watcher) -> None:
    """Compute the random experiments that tastes of missing cells need; they are kept."""
    missing = (c for c in suite.cells if c.calibrator in TASTES and not store.path(c).exists())
    wanted = dict.fromkeys(cell.problem for cell in missing)
    with alone():  # it runs a few experiments, and people's own may print
        tasks = {name: partial(_prepared, name) for name in wanted if not problem(name).is_prepared}
    if tasks:
        watcher.begin("random experiments", len(tasks), 0)
    with closing(each(tasks, workers)) as landing:
        for name, result in landing:
            if isinstance(result, RunError):
                watcher.say(f"random experiments of {name}: {result}")
            watcher.landed(name)


def _prepared(name: str) -> bool:
    with alone():
        problem(name).prepare()
    return True


def _cells(suite: Suite, store: Store, workers: Processes | None, watcher: Watcher) -> tuple[Result, ...]:
    found = {cell: _found(store.find(cell), "it runs again", watcher) for cell in suite.cells}
    results = {cell: result for cell, result in found.items() if result is not None and not result.failure}
    # Times are meaningless while anything else runs on the machine.
    clock = time.perf_counter if workers is None or workers.jobs == 1 else None
    tasks = {cell: partial(run_cell, cell, clock, cell.key) for cell in found if cell not in results}
    watcher.begin("cells", len(found), len(results))
    with closing(each(tasks, workers)) as landing:
        for cell, result in landing:
            done = Result.failed(cell, str(result)) if isinstance(result, RunError) else result
            store.add(done)
            results[cell] = done
            if done.failure:
                watcher.say(f"{cell} failed: {done.failure}")
            watcher.landed(f"{cell.agent} on {cell.problem}")
    return tuple(results[cell] for cell in sorted(results))


def _duels(
    results: tuple[Result, ...], store: Store, workers: Processes | None, watcher: Watcher
) -> tuple[tuple[Duel, ...], tuple[str, ...]]:
    played = {one: _found(store.duels(one), "it is played again", watcher) for one in rounds(results)}
    tasks = {one: partial(play, one) for one, duels in played.items() if duels is None}
    troubles: list[str] = []
    if tasks:
        watcher.begin("duels", len(played), len(played) - len(tasks))
    with closing(each(tasks, workers)) as landing:
        for one, duels in landing:
            where = f"duels of {one.problem}, {one.calibrator}, seed {one.seed}"
            if isinstance(duels, RunError):
                troubles.append(f"{where}: {duels}")
                watcher.say(troubles[-1])
                continue
            store.add_duels(one, duels)
            played[one] = duels
            watcher.landed(where)
    return tuple(sorted(duel for duels in played.values() for duel in duels or ())), tuple(troubles)


def _found(stored: tuple[T | None, Trouble], what: str, watcher: Watcher) -> T | None:
    """Return what is stored, and say what is wrong with it."""
    found, trouble = stored
    if trouble:
        watcher.say(f"{trouble}; {what}")
    return found
