"""Run the missing cells of a suite, even if workers die."""

import time
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from prefcal_bench.people import TASTES
from prefcal_bench.problems import problem
from prefcal_env.errors import RunError

from .cell import Cell
from .duels import Duel, Round, play, rounds
from .engine import Processes, each
from .result import Result, digest
from .run import alone, run_cell
from .store import Store
from .suite import Suite


class Watcher(Protocol):
    """Display of progress."""

    def begin(self, what: str, total: int, done: int) -> None:
        """Start a phase with `total` items, of which `done` are there already."""

    def landed(self, what: str) -> None:
        """Count one more item as done."""

    def say(self, words: str) -> None:
        """Print a message for the user."""


@dataclass(frozen=True)
class Finished:
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


def run_suite(suite: Suite, store: Store, workers: Processes | None, watcher: Watcher) -> Finished:
    """Run all cells of `suite` that have no result in `store` or failed.

    Every result is stored when it completes, so an interruption loses only running cells.

    Raises:
        BenchmarkError: If the folder or the workers can no longer be used.
    """
    _prepare(suite, store, workers, watcher)
    results = _cells(suite, store, workers, watcher)
    duels, trouble = _duels(results, store, workers, watcher)
    return Finished(results, duels, trouble)


def _prepare(suite: Suite, store: Store, workers: Processes | None, watcher: Watcher) -> None:
    """Compute the random experiments that tastes of missing cells need; they are kept."""
    missing = (c for c in suite.cells if c.calibrator in TASTES and not store.path(c).exists())
    wanted = dict.fromkeys(cell.problem for cell in missing)
    with alone():  # it runs a few experiments, and people's own may print
        names = [name for name in wanted if not problem(name).is_prepared]
    if names:
        watcher.begin("random experiments", len(names), 0)
    with closing(each([partial(_prepared, name) for name in names], workers)) as landing:
        for number, result in landing:
            if isinstance(result, RunError):
                watcher.say(f"random experiments of {names[number]}: {result}")
            watcher.landed(names[number])


def _prepared(name: str) -> bool:
    with alone():
        problem(name).prepare()
    return True


def _cells(suite: Suite, store: Store, workers: Processes | None, watcher: Watcher) -> tuple[Result, ...]:
    results: dict[Cell, Result] = {}
    for cell in suite.cells:
        found, trouble = store.find(cell)
        if trouble:
            watcher.say(f"{trouble}; it runs again")
        if found is not None and not found.failure:
            results[cell] = found
    missing = [cell for cell in suite.cells if cell not in results]
    # Times are meaningless while anything else runs on the machine.
    clock = time.perf_counter if workers is None or workers.jobs == 1 else None
    tasks = [partial(run_cell, cell, clock, cell.key) for cell in missing]
    watcher.begin("cells", len(suite.cells), len(results))
    with closing(each(tasks, workers)) as landing:
        for number, result in landing:
            cell = missing[number]
            if isinstance(result, RunError):
                result = Result.failed(cell, str(result))
            store.add(result)
            results[cell] = result
            if result.failure:
                watcher.say(f"{cell} failed: {result.failure}")
            watcher.landed(f"{cell.agent} on {cell.problem}")
    return tuple(results[cell] for cell in sorted(results))


def _duels(
    results: tuple[Result, ...], store: Store, workers: Processes | None, watcher: Watcher
) -> tuple[tuple[Duel, ...], tuple[str, ...]]:
    found: dict[Round, tuple[Duel, ...]] = {}
    troubles: list[str] = []
    every = rounds(results)
    for round_ in every:
        played, trouble = store.duels(round_)
        if trouble:
            watcher.say(f"{trouble}; it is played again")
        if played is not None:
            found[round_] = played
    missing = [round_ for round_ in every if round_ not in found]
    if missing:
        watcher.begin("duels", len(every), len(found))
    with closing(each([partial(play, round_) for round_ in missing], workers)) as landing:
        for number, played_now in landing:
            round_ = missing[number]
            where = f"{round_.problem}, {round_.calibrator}, seed {round_.seed}"
            if isinstance(played_now, RunError):
                troubles.append(f"duels of {where}: {played_now}")
                watcher.say(troubles[-1])
                continue
            store.add_duels(round_, played_now)
            found[round_] = played_now
            watcher.landed(f"duels of {where}")
    return tuple(sorted(d for duels in found.values() for d in duels)), tuple(troubles)
