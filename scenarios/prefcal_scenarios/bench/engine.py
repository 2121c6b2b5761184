"""Runs tasks on workers that may die, and finds out which task killed them."""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from prefcal_env.errors import BenchmarkError
from prefcal_scenarios.own_line import whole

from .executors import Workers

T = TypeVar("T")
_PATIENCE = 0.5
"""Seconds after which the engine looks around: for new workers, or none."""

_ATTEMPTS = 3
"""To open an executor that takes a task."""


@dataclass(frozen=True, slots=True)
class Lost:
    """A task without a result, and why."""

    why: str


def each(
    tasks: Sequence[Callable[[], T]], workers: Workers
) -> Generator[tuple[int, T | Lost], None, None]:
    """Run all `tasks`; yield the number and the result of each as it lands, in any order.

    When a worker dies, whatever was running is suspect: it is run again, one by one, with nothing
    beside it. The one whose worker dies again is `Lost`, and so is a task that raises, or takes
    longer than the workers allow; all others get their results. Closing the iterator drops what is
    running.

    Args:
        tasks: Functions that can be pickled.
        workers: Where they run.

    Raises:
        BenchmarkError: the workers are all gone, or cannot be had.
    """
    crew = _Crew(tasks, workers)
    finished = False
    try:
        yield from crew.results()
        finished = True
    finally:
        workers.close(at_once=not finished)


class _Crew(Generic[T]):
    """The tasks on their way: waiting, in flight, suspect."""

    def __init__(self, tasks: Sequence[Callable[[], T]], workers: Workers) -> None:
        self._tasks, self._workers = tasks, workers
        self._waiting = deque(range(len(tasks)))
        self._suspects: deque[int] = deque()
        self._alone: int | None = None
        self._flying: dict[Future[Any], int] = {}
        self._since: dict[int, float] = {}
        self._pool: Executor | None = None

    def results(self) -> Iterator[tuple[int, T | Lost]]:
        """Run everything."""
        while self._waiting or self._suspects or self._flying:
            self._launch()
            done, _ = wait(self._flying, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
            self._workers.width()  # raises if nobody is left
            for future in done:
                yield from self._landed(self._flying.pop(future), future)
            yield from self._overdue()

    def _landed(self, number: int, future: Future[Any]) -> Iterator[tuple[int, T | Lost]]:
        error = _error(future)
        if error is None:
            yield number, future.result()
        elif not self._workers.died(error):
            yield number, Lost(whole(f"{type(error).__name__}: {error}"))
        elif number == self._alone:
            yield number, Lost("its worker died, and again when it ran with nothing beside it")
        else:
            self._suspects.append(number)

    def _overdue(self) -> Iterator[tuple[int, T | Lost]]:
        """Give up what takes too long, with all workers: nothing else stops compiled code.

        What ran beside it begins again.
        """
        limit, now = self._workers.limit, time.monotonic()
        late = [number for number in self._flying.values() if now - self._since[number] > limit]
        if not late:
            return
        self._waiting.extendleft(n for n in self._flying.values() if n not in late)
        self._workers.close(at_once=True)
        self._flying, self._pool = {}, None
        for number in late:
            yield number, Lost(f"it took longer than {limit:g} s and was ended (--cell-timeout)")

    def _launch(self) -> None:
        """Put tasks in flight: suspects alone, others as many as there are workers."""
        if self._suspects:
            if not self._flying:
                self._alone = self._suspects.popleft()
                self._submit(self._alone)
            return
        while self._waiting and len(self._flying) < self._workers.width():
            self._submit(self._waiting.popleft())

    def _submit(self, number: int) -> None:
        for _ in range(_ATTEMPTS):
            if self._pool is None:
                self._pool = self._workers.open()
            try:
                self._flying[self._pool.submit(self._tasks[number])] = number
                self._since[number] = time.monotonic()
                return
            except BrokenExecutor:
                self._workers.close(at_once=True)
                self._pool = None
        raise BenchmarkError("workers die as soon as they are started")


def _error(future: Future[Any]) -> BaseException | None:
    """Why there is no result."""
    try:
        return future.exception()
    except CancelledError as error:
        return error
