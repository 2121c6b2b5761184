"""Run tasks in worker processes that may die, or in this process."""

import pickle
from collections.abc import Callable, Generator, Hashable, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any, TypeVar, final

import cloudpickle
import numpy as np

from prefcal_env.arrays import integer
from prefcal_env.errors import BenchmarkError, RunError, SettingsError
from prefcal_env.workers import Pool, Terms, failure, run_all

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")
Task = Callable[[], T]
_TERMS = Terms("the task", "--cell-timeout")


@dataclass(frozen=True, slots=True)
class Processes:
    """Processes on this machine that run tasks.

    Args:
        jobs: Number of processes, 1 or more.
        limit: Time limit of a task in seconds.
        last_words: Message that a process prints on standard error if this process is killed.

    Raises:
        SettingsError: If `jobs` is below 1, or `limit` is not above 0.
    """

    jobs: int
    limit: float = np.inf
    last_words: str = ""

    def __post_init__(self) -> None:
        jobs = self.jobs
        integer("jobs", jobs, low=1)
        if not self.limit > 0:
            raise SettingsError(f"the time limit of a cell must be above 0 s, got {self.limit:g}")


def each(
    tasks: Mapping[K, Task[T]], workers: Processes | None
) -> Generator[tuple[K, T | RunError], None, None]:
    """Run all `tasks`; yield the key and the result of each when it completes, in any order.

    The result of a task that raises, takes too long, or whose process dies twice, is the RunError
    that says so; all others get their results. Closing the iterator drops running tasks.

    Args:
        tasks: Functions that can be pickled.
        workers: Processes that run them; None for this process, which saves starting others.

    Raises:
        BenchmarkError: If workers die as soon as they start.
    """
    if workers is None:
        for key, task in tasks.items():
            yield key, _here(task)
        return
    if not tasks:
        return
    work = pickle.dumps((_Tasks, (workers.last_words,)))
    jobs, keys = min(workers.jobs, len(tasks)), list(tasks)
    pool = Pool(lambda: work, jobs, workers.limit, _TERMS, unloadable=_unloadable)
    with closing(run_all(pool, map(_request, tasks.values()))) as arriving:
        for arrived in arriving:
            yield from ((keys[number], result) for number, result in arrived)


def _here(task: Task[Any]) -> Any:
    """Return the result of a task in this process, or the RunError that says what it raised."""
    try:
        return task()
    except BaseException as error:
        return failure(error)


def _request(task: Task[Any]) -> tuple[str, bytes]:
    """Return what a task is about, and the task itself, also if it is of the main script."""
    return "".join(map(str, getattr(task, "args", ())[:1])), cloudpickle.dumps(task)


def _unloadable(error: RunError) -> BenchmarkError:
    return BenchmarkError(f"workers die as soon as they are started: {error}")


@final
class _Tasks:
    """What runs tasks in a worker, and knows which one is running."""

    def __init__(self, last_words: str) -> None:
        self._last_words, self._about = last_words, ""

    def __call__(self, request: tuple[str, bytes]) -> Any:
        self._about, content = request
        return pickle.loads(content)()

    def last_words(self) -> str:
        """Return what is printed if the benchmark is killed meanwhile."""
        words = f"\nprefcal: {self._last_words}\nprefcal: {self._about} was running then\n"
        return words if self._last_words else ""
