"""Several workers with one queue: requests run as they come, whatever happens to some of them."""

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from itertools import islice
from statistics import median
from typing import Any, final

import numpy as np

from prefcal_env.errors import RunError

from .worker import LOOK, Terms, Worker

_KNOWN = 5  # number of messages after which the time of a request is known
_UNKNOWN = 60.0  # time limit of a gentle request in seconds until then
_SHORTEST, _TIMES = 5.0, 10.0
"""Time limit afterwards: this many seconds, or this many times the median if that is more."""

Arrived = tuple[int, Any, Any]  # number, request and result, which is a RunError if there is none


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@final
class Pool:
    """Workers that run requests as they come. All methods but `wake` are for one thread.

    Args:
        work: Function that returns the pickled work, as for a `Worker`; it is called once.
        jobs: Number of workers, 1 or more.
        longest: Largest time limit of a request in seconds; infinite for none.
        read: Function of request and result that returns what `collect` returns.
        unloadable: Function that returns what to raise if no process can load the work.
    """

    def __init__(
        self,
        work: Callable[[], bytes],
        jobs: int,
        longest: float,
        terms: Terms,
        *,
        read: Callable[[Any, Any], Any] = lambda request, result: result,
        unloadable: Callable[[RunError], Exception] = lambda error: error,
    ) -> None:
        self._work, self._longest, self._gentle = work, longest, terms.gentle
        self._read, self._unloadable = read, unloadable
        self._bell = threading.Event()
        self._content: bytes | None = None
        self._workers = [Worker(self._packed, longest, terms, self._bell) for _ in range(jobs)]
        self._requests: dict[int, Any] = {}  # waiting or running
        self._waiting: deque[int] = deque()
        self._seconds: deque[float] = deque(maxlen=100)
        self._count, self._closed = 0, False

    @property
    def loaded(self) -> bool:
        """Return whether a worker has loaded the work, so that requests run elsewhere."""
        return any(worker.loaded for worker in self._workers)

    @property
    def limit(self) -> float:
        """Return the time limit of a request in seconds."""
        if not self._gentle:
            return self._longest
        usual = _UNKNOWN
        if len(self._seconds) >= _KNOWN:
            usual = max(_SHORTEST, _TIMES * median(self._seconds))
        return min(usual, self._longest)

    @property
    def room(self) -> int:
        """Return how many more requests the workers can be given now, or when one is ready."""
        room = sum(worker.room for worker in self._workers if worker.loaded)
        return max((room or len(self._workers)) - len(self._waiting), 0)

    def start(self) -> None:
        """Start the workers that are missing, so that they load the work meanwhile."""
        for worker in () if self._closed else self._workers:
            if worker.pid is None:
                worker.limit = self.limit
                worker.start()

    def give(self, requests: Sequence[Any]) -> None:
        """Add requests to those that wait; they are numbered from 0 on."""
        for request in requests:
            self._requests[self._count] = request
            self._waiting.append(self._count)
            self._count += 1

    def take_back(self) -> Any | None:
        """Return a request that waits, which the caller runs; None if there is none."""
        return self._requests.pop(self._waiting.pop()) if self._waiting else None

    def drop(self) -> None:
        """Forget what waits; what runs goes on, and `collect` returns its results."""
        while self.take_back() is not None:
            pass

    def collect(self, *, patient: bool) -> list[Arrived]:
        """Hand out what waits, and return what has arrived, in any order.

        Args:
            patient: Whether to wait for something to arrive, for a moment.

        Raises:
            RunError: If no worker can load the work, or what `unloadable` returns.
        """
        if self._closed:
            return []
        self.start()
        self._hand_out()
        if patient:
            left = min(worker.left for worker in self._workers)
            self._bell.wait(min(max(left, 0.0), LOOK))
        self._bell.clear()
        try:
            return [arrived for worker in self._workers for arrived in self._heard(worker)]
        except RunError as error:
            if self._closed:
                return []
            raise self._unloadable(error) from error

    def wake(self) -> None:
        """Let `collect` return at once."""
        self._bell.set()

    def close(self, *, gently: bool = False) -> None:
        """End all workers, perhaps so that their code can clean up; nothing can run afterwards."""
        self._closed = True
        for worker in self._workers if gently else ():  # all end at the same time
            worker.dismiss()
        for worker in self._workers:
            worker.close(gently=gently)

    def _packed(self) -> bytes:
        if self._content is None:
            self._content = self._work()
        return self._content

    def _hand_out(self) -> None:
        # Until a worker is ready, its share is better left to others.
        limit, ready = self.limit, [worker for worker in self._workers if worker.loaded]
        for most in (1, np.inf):  # the first one for everybody, then the next ones
            for worker in ready:
                worker.limit = limit
                room = min(worker.room, max(most - worker.given, 0), len(self._waiting))
                if numbers := [self._waiting.popleft() for _ in range(int(room))]:
                    worker.give([(number, self._requests[number]) for number in numbers])

    def _heard(self, worker: Worker) -> list[Arrived]:
        found = worker.poll()
        if found and worker.loaded:
            self._seconds.append(worker.pace)
        requests = [(number, self._requests.pop(number), result) for number, result in found]
        return [(number, request, self._read(request, r)) for number, request, r in requests]


def run_all(
    pool: Pool, requests: Iterable[Any], ahead: float = np.inf
) -> Generator[list[tuple[int, Any]], None, None]:
    """Run all requests, and yield numbers and results as they arrive; then close the pool.

    Closing the generator ends what runs.

    Args:
        pool: Pool that has run nothing yet.
        requests: Requests, numbered from 0 on; read only as far as needed.
        ahead: Largest number of results that may have arrived before an earlier one.
    """
    source, waiting, given = iter(requests), set[int](), 0
    try:
        while True:
            allowed = min(pool.room, ahead + min(waiting, default=given) - given)
            new = list(islice(source, int(max(allowed, 0))))
            pool.give(new)
            waiting.update(range(given, given + len(new)))
            given += len(new)
            if not waiting:
                break
            if arrived := pool.collect(patient=True):
                waiting.difference_update(number for number, _, _ in arrived)
                yield [(number, result) for number, _, result in arrived]
        pool.close(gently=True)
    finally:
        pool.close()
