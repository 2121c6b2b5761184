"""Run tasks on workers that may die, and name the task that killed its worker."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar, final

from prefcal_env.own_line import described, whole

T = TypeVar("T")
Task = Callable[[], T]
_PATIENCE = 0.5
"""Interval at which the number of workers is checked, in seconds."""
_RUNNING: list[str] = []
"""Description of the current task, in a worker."""


@dataclass(frozen=True, slots=True)
class Lost:
    """A task without a result, and the reason."""

    why: str


class Workers(Protocol):
    """Processes that run tasks."""

    @property
    def serial(self) -> bool:
        """Return whether tasks run one by one, so that times are comparable."""

    def open(self, tasks: int) -> None:
        """Prepare to run `tasks` tasks."""

    def width(self) -> int:
        """Return the number of tasks that can run at the same time at present."""

    def submit(self, task: Callable[[], Any]) -> Future[Any]:
        """Start `task`; its future holds an exception only if the worker did not finish it.

        Raises:
            BenchmarkError: If workers die as soon as they start.
        """

    def close(self, *, at_once: bool) -> None:
        """Release the workers; `at_once` drops running tasks."""

    def why(self, error: BaseException) -> str:
        """Return why a task has no result; empty if its worker died."""


@final
class Here:
    """Workers that are this process, which saves starting others: one task at a time."""

    @property
    def serial(self) -> bool:
        """Return True: nothing else runs meanwhile."""
        return True

    def open(self, tasks: int) -> None:
        """Do nothing: there is nothing to start."""

    def width(self) -> int:
        """Return 1."""
        return 1

    def submit(self, task: Callable[[], Any]) -> Future[Any]:
        """Run `task` now, and return its result as a future that is done."""
        future: Future[Any] = Future()
        future.set_result(task())  # tasks return what they raise
        return future

    def close(self, *, at_once: bool) -> None:
        """Do nothing: nothing is left running."""

    def why(self, error: BaseException) -> str:
        """Return why a task has no result."""
        return f"{type(error).__name__}: {error}"


def each(tasks: Sequence[Task[T]], workers: Workers) -> Generator[tuple[int, T | Lost], None, None]:
    """Run all `tasks`; yield the number and the result of each when it completes, in any order.

    A worker can also be killed from outside or for lack of memory. So if a worker dies, its task
    runs again at the end, alone. If it dies again, the task is `Lost`, as is a task that raises or
    exceeds the time limit of the workers. All other tasks get their results. Closing the iterator
    drops running tasks.

    Args:
        tasks: Functions that can be pickled.
        workers: Workers that run them.

    Raises:
        BenchmarkError: If workers die as soon as they start.
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
        dead = Lost("its worker died, and again when it ran alone")
        for suspect in sorted(suspects):
            for number, result in _round([suspect], tasks, workers):
                yield number, dead if result is None else result[0]
        finished = True
    finally:
        workers.close(at_once=not finished)


def _round(
    numbers: Iterable[int], tasks: Sequence[Task[T]], workers: Workers
) -> Iterator[tuple[int, tuple[T | Lost] | None]]:
    """Run the tasks with these numbers; yield None as the result if the worker died."""
    waiting = deque(numbers)
    flying: dict[Future[Any], int] = {}
    while waiting or flying:
        width = workers.width()
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
    """Run `task` in a worker; return exceptions as text, since not all can be pickled.

    No Ctrl-C arrives in a worker, so KeyboardInterrupt is the task's own.
    """
    _RUNNING[:] = [str(about) for about in getattr(task, "args", ())[:1]]
    try:
        return task()
    except BaseException as error:
        return Lost(described(error))


def running() -> str:
    """Return the description of this worker's latest task; empty before the first one."""
    return _RUNNING[0] if _RUNNING else ""
