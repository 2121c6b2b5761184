"""Worker processes that run θ after θ, whatever happens to some of them."""

import threading
from collections import deque
from collections.abc import Sequence
from itertools import islice
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

_TWICE = "the run crashed, and again when it ran alone"
Theta = Float[np.ndarray, " n"]
Arrived = tuple[int, Theta, Result]


@final
class Pool:
    """Workers that run θ as they come; one that dies or takes too long is replaced.

    If a worker dies, it may have been killed from outside, or for lack of memory. So each θ that
    may have ended it runs once more, alone in its worker. If that one dies, too, the run has
    failed. All methods but `wake` are for one thread.

    Args:
        task: What to do with each θ.
        jobs: Number of workers, 1 or more.
        longest: Largest time limit of an experiment in seconds; infinite for none.
        behind: Whether they work behind a person's back: they leave the processor to whatever the
            person waits for, and the time limit follows the usual time of an experiment.
    """

    def __init__(self, task: Task, jobs: int, longest: float, *, behind: bool = True) -> None:
        self._task, self._jobs, self._longest, self._behind = task, jobs, longest, behind
        self._bell = threading.Event()
        self._workers: list[Worker] = []
        self._thetas: dict[int, Theta] = {}  # waiting or running
        self._waiting: deque[int] = deque()
        self._suspects: set[int] = set()  # their first worker died: they run alone
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
        if not self._behind:
            return self._longest
        usual = _UNKNOWN
        if len(self._seconds) >= _KNOWN:
            usual = max(_SHORTEST, _TIMES * median(self._seconds))
        return min(usual, self._longest)

    @property
    def room(self) -> int:
        """Return how many more θ the workers can be given now, or when one is ready."""
        room = sum(max(w.room, _AT_HAND - len(w.given)) for w in self._workers if w.life.loaded)
        return max((room or self._jobs) - len(self._waiting), 0)

    def start(self) -> None:
        """Start the workers that are missing, so that they load the scenario meanwhile.

        Raises:
            ScenarioError: If the run cannot be sent to another process.
        """
        if self._closed or len(self._workers) == self._jobs:
            return
        task = packed(self._task)
        while len(self._workers) < self._jobs:
            self._workers.append(Worker(self.limit, self._bell, gentle=self._behind))
            self._workers[-1].life.ask(task)

    def give(self, thetas: Sequence[Theta]) -> None:
        """Add θ, physical, each of shape (n,), to those that wait; they are numbered from 0 on."""
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

    def collect(self, *, patient: bool) -> list[Arrived]:
        """Hand out waiting θ, and return number, θ and result of what has arrived, in any order.

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

    def close(self, *, gently: bool = False) -> None:
        """End all workers, perhaps so that their code can clean up; nothing can run afterwards."""
        self._closed = True
        workers, self._workers = self._workers, []
        for worker in workers if gently else ():  # all end at the same time
            worker.life.dismiss()
        for worker in workers:
            worker.life.leave() if gently else worker.life.kill()

    def _hand_out(self) -> None:
        # Until a worker is ready, its share is better left to others.
        limit, ready = self.limit, [w for w in self._workers if w.life.loaded]
        for worker in ready:
            worker.timeout = limit
        for at_hand in range(_AT_HAND):  # the first one for everybody, then the next ones
            for worker in ready:
                room = max(worker.room, at_hand + 1 - len(worker.given))
                if numbers := self._chosen(worker, room):
                    worker.give(numbers, [self._thetas[number] for number in numbers])

    def _chosen(self, worker: Worker, room: int) -> list[int]:
        """Return the numbers of the next θ for a worker; a suspect is given alone."""
        waiting, suspects = self._waiting, self._suspects
        if worker.given and not suspects.isdisjoint([worker.given[0], *islice(waiting, 1)]):
            return []
        if waiting and waiting[0] in suspects:
            return [waiting.popleft()]
        chosen: list[int] = []
        while waiting and len(chosen) < room and waiting[0] not in suspects:
            chosen.append(waiting.popleft())
        return chosen

    def _heard(self, worker: Worker) -> list[Arrived]:
        found = worker.hear()
        if found:
            self._seconds.append(worker.pace)
        settled = [(number, self._thetas.pop(number), result) for number, result in found]
        if worker.life.loaded:
            self._fruitless = 0
        if worker.life.gone:
            settled += self._died(worker, worker.life.ended())
        elif worker.left <= 0:
            settled += self._late(worker)
        return settled

    def _died(self, worker: Worker, words: str) -> list[Arrived]:
        numbers = self._removed(worker)
        if not worker.life.loaded:
            self._fruitless += 1
            if self._fruitless >= _FRUITLESS:
                raise ScenarioError(f"no process can load the scenario: {words}")
        if numbers and numbers[0] in self._suspects:
            return [self._failed(numbers[0], "died", f"{_TWICE}: {words}")]
        self._suspects.update(numbers if worker.in_groups else numbers[:1])
        self._waiting.extendleft(reversed(numbers))
        return []

    def _late(self, worker: Worker) -> list[Arrived]:
        numbers, limit = self._removed(worker), worker.timeout
        if not worker.life.loaded:
            raise ScenarioError("loading the scenario takes too long")
        self._waiting.extendleft(reversed(numbers[1:]))
        words = f"the run took longer than {limit:g} s and was ended"
        return [self._failed(numbers[0], "late", words if self._behind else f"{words} (timeout)")]

    def _failed(self, number: int, why: str, words: str) -> Arrived:
        theta = self._thetas.pop(number)
        return number, theta, FailedRun(theta, why, words)

    def _removed(self, worker: Worker) -> list[int]:
        self._workers.remove(worker)
        worker.life.kill()
        return list(worker.given)
