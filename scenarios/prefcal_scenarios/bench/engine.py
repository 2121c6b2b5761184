"""Run tasks on workers that may die, and name the task that killed its worker."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

from prefcal_scenarios.own.own_line import whole

T = TypeVar("T")
Task = Callable[[], T]
_PATIENCE = 0.5
"""Seconds between two looks at whether workers have come or gone."""
_RUNNING: list[str] = []
"""In a worker: what its task is about."""


@dataclass(frozen=True, slots=True)
class Lost:
    """A task without a result, and why."""

    why: str


class Workers(Protocol):
    """Processes that run tasks, here or elsewhere."""

    @property
    def serial(self) -> bool:
        """Whether tasks run one by one on this machine: only then are times worth anything."""

    def open(self, tasks: int) -> None:
        """Get ready to run that many tasks.

        Raises:
            BenchmarkError: the workers cannot be reached.
        """

    def width(self) -> int:
        """Return the number of tasks that can run at the same time, now.

        Raises:
            BenchmarkError: no worker is left.
        """

    def submit(self, task: Callable[[], Any]) -> Future[Any]:
        """Start `task`; its future holds an exception only if the worker never finished it.

        Raises:
            BenchmarkError: workers die as soon as they start.
        """

    def close(self, *, at_once: bool) -> None:
        """Give the workers up; `at_once` drops what is running."""

    def why(self, error: BaseException) -> str:
        """Return why a task has no result, in words; empty if its worker died."""


def each(tasks: Sequence[Task[T]], workers: Workers) -> Generator[tuple[int, T | Lost], None, None]:
    """Run all `tasks`; yield the number and the result of each as it lands, in any order.

    A task whose worker dies is run again at the end with nothing beside it, since a worker can
    also be killed from outside or for lack of memory. If its worker dies again it is `Lost`; so is
    a task that raises, or that takes longer than the workers allow. All others get their results.
    Closing the iterator drops what is running.

    Args:
        tasks: Functions that can be pickled.
        workers: Where they run.

    Raises:
        BenchmarkError: the workers are all gone, or cannot be reached.
    """
    if not tasks:
        return
    suspects: list[int] = []
    finished = False
    try:
        workers.open(len(tasks))
        for number, result in _round(range(len(tasks)), tasks, workers):
            if result is None:
                suspects.append(number)
            else:
                yield number, result[0]
        dead = Lost("its worker died, and again when it ran with nothing beside it")
        for suspect in sorted(suspects):
            for number, result in _round([suspect], tasks, workers):
                yield number, dead if result is None else result[0]
        finished = True
    finally:
        workers.close(at_once=not finished)


def _round(
    numbers: Iterable[int], tasks: Sequence[Task[T]], workers: Workers
) -> Iterator[tuple[int, tuple[T | Lost] | None]]:
    """Run the tasks of these numbers; yield None in place of a result if the worker died."""
    waiting = deque(numbers)
    flying: dict[Future[Any], int] = {}
    while waiting or flying:
        width = workers.width()  # raises if no worker is left
        while waiting and len(flying) < width:
            number = waiting.popleft()
            flying[workers.submit(partial(_attempt, tasks[number]))] = number
        done, _ = wait(flying, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
        for future in done:
            yield flying.pop(future), _landed(future, workers)


def _landed(future: Future[Any], workers: Workers) -> tuple[Any] | None:
    try:
        return (future.result(),)
    except (Exception, CancelledError) as error:
        words = workers.why(error)
        return (Lost(whole(words)),) if words else None


def _attempt(task: Task[T]) -> T | Lost:
    """In a worker: run `task`. Exceptions become words here, since not all can be pickled."""
    _RUNNING[:] = [str(about) for about in getattr(task, "args", ())[:1]]
    try:
        return task()
    except (Exception, SystemExit) as error:
        return Lost(whole(f"{type(error).__name__}: {error}"))


def running() -> str:
    """Return what this worker's latest task is about; empty before the first one."""
    return _RUNNING[0] if _RUNNING else ""
