"""Worker processes that stay from one batch of θ to the next, for simulations in the background."""

import threading
from collections import deque
from collections.abc import Sequence
from statistics import median
from typing import final

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError

from .results import FailedRun, Result
from .task import Task, packed
from .worker import Worker

_LOOK = 0.2
"""Longest wait for results in seconds: after it, the workers are looked at."""
_AT_HAND = 2
"""Number of θ that a worker has: the one that runs and the next, so that it never waits."""
_KNOWN = 5
"""Number of experiments after which their time is known."""
_UNKNOWN = 60.0
"""Time limit of an experiment in seconds until then."""
_SHORTEST, _TIMES = 5.0, 10.0
"""Time limit afterwards: this many seconds, or this many times the median if that is more."""
_FRUITLESS = 3
"""Number of workers that may die in a row without loading the scenario."""

Theta = Float[np.ndarray, " n"]


@final
class Pool:
    """Workers that run θ as they come; one that dies or takes too long is replaced.

    A θ whose worker died runs once more, since the worker may have been killed from outside. If
    that worker dies, too, the run has failed. All methods but `wake` are for one thread.

    Args:
        task: What to do with each θ.
        jobs: Number of workers, 1 or more.
        longest: Largest time limit of an experiment in seconds; infinite for none.
    """

    def __init__(self, task: Task, jobs: int, longest: float) -> None:
        self._task, self._jobs, self._longest = task, jobs, longest
        self._bell = threading.Event()
        self._workers: list[Worker] = []
        self._thetas: dict[int, Theta] = {}  # waiting or running
        self._waiting: deque[int] = deque()
        self._suspects: set[int] = set()  # their first worker died
        self._seconds: deque[float] = deque(maxlen=100)
        self._count = self._fruitless = 0
        self._closed = False

    @property
    def loaded(self) -> bool:
        """Return whether a worker has loaded the scenario, so that θ run elsewhere."""
        return any(worker.life.loaded for worker in self._workers)

    @property
    def limit(self) -> float:
        """Return the time limit of an experiment in seconds."""
        usual = _UNKNOWN
        if len(self._seconds) >= _KNOWN:
            usual = max(_SHORTEST, _TIMES * median(self._seconds))
        return min(usual, self._longest)

    def start(self) -> None:
        """Start the workers that are missing, so that they load the scenario meanwhile.

        Raises:
            ScenarioError: If the run cannot be sent to another process.
        """
        if self._closed or len(self._workers) == self._jobs:
            return
        task = packed(self._task)
        while len(self._workers) < self._jobs:
            self._workers.append(Worker(self.limit, self._bell, gentle=True))
            self._workers[-1].life.ask(task)

    def give(self, thetas: Sequence[Theta]) -> None:
        """Add θ, physical, each of shape (n,), to those that wait."""
        for theta in thetas:
            self._thetas[self._count] = theta
            self._waiting.append(self._count)
            self._count += 1

    def take_back(self) -> Theta | None:
        """Return a θ that waits, which the caller runs; None if there is none."""
        return self._thetas.pop(self._waiting.pop()) if self._waiting else None

    def drop(self) -> None:
        """Forget the θ that wait; those that run go on, and `collect` returns their results."""
        while self.take_back() is not None:
            pass

    def collect(self, *, patient: bool) -> list[tuple[Theta, Result]]:
        """Hand out waiting θ, and return what has arrived, in any order.

        Args:
            patient: Whether to wait for something to arrive, for a moment.

        Raises:
            ScenarioError: If no worker can load the scenario.
        """
        self.start()
        self._hand_out()
        if patient:
            left = min((worker.left for worker in self._workers), default=_LOOK)
            self._bell.wait(max(min(_LOOK, left), 0.0))
        self._bell.clear()
        return [found for worker in list(self._workers) for found in self._heard(worker)]

    def wake(self) -> None:
        """Let `collect` return at once."""
        self._bell.set()

    def close(self) -> None:
        """End all workers; nothing can run afterwards."""
        self._closed = True
        workers, self._workers = self._workers, []
        for worker in workers:
            worker.life.kill()

    def _hand_out(self) -> None:
        # Until a worker is ready, its share is better left to others.
        limit, ready = self.limit, [w for w in self._workers if w.life.loaded]
        for worker in ready:
            worker.timeout = limit
        for at_hand in range(_AT_HAND):  # the first one for everybody, then the next ones
            for worker in ready:
                if self._waiting and len(worker.given) <= at_hand:
                    number = self._waiting.popleft()
                    worker.give([number], [self._thetas[number]])

    def _heard(self, worker: Worker) -> list[tuple[Theta, Result]]:
        found = worker.hear()
        if found:
            self._seconds.append(worker.pace)
        settled = [(self._thetas.pop(number), result) for number, result in found]
        if worker.life.loaded:
            self._fruitless = 0
        if worker.life.gone:
            settled += self._died(worker, worker.life.ended())
        elif worker.left <= 0:
            settled += self._late(worker)
        return settled

    def _died(self, worker: Worker, words: str) -> list[tuple[Theta, Result]]:
        numbers = self._removed(worker)
        if not worker.life.loaded:
            self._fruitless += 1
            if self._fruitless >= _FRUITLESS:
                raise ScenarioError(f"no process can load the scenario: {words}")
        if not worker.life.loaded or not self._suspects.issuperset(numbers[:1]):
            if worker.life.loaded:
                self._suspects.update(numbers[:1])
            self._waiting.extendleft(reversed(numbers))
            return []
        if not numbers:
            return []
        self._waiting.extendleft(reversed(numbers[1:]))
        theta = self._thetas.pop(numbers[0])
        return [(theta, FailedRun(theta, "died", f"the run crashed twice: {words}"))]

    def _late(self, worker: Worker) -> list[tuple[Theta, Result]]:
        numbers, limit = self._removed(worker), worker.timeout
        if not worker.life.loaded:
            raise ScenarioError("loading the scenario takes too long")
        self._waiting.extendleft(reversed(numbers[1:]))
        theta = self._thetas.pop(numbers[0])
        words = f"the run took longer than {limit:g} s and was ended"
        return [(theta, FailedRun(theta, "late", words))]

    def _removed(self, worker: Worker) -> list[int]:
        self._workers.remove(worker)
        worker.life.kill()
        return list(worker.given)
