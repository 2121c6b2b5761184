"""Hand out θ to worker processes, and put their results in order, whatever happens to them."""

import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from itertools import islice
from typing import final

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError

from .results import FailedRun, Result
from .task import Task, packed
from .worker import Worker

_LOOK = 0.2
"""Seconds between checks whether the processes still exist."""


@final
class Dispatch:
    """Runs θ on workers; a worker that dies is replaced, and costs nobody else a result.

    If a worker dies, it could also have been killed from outside or for lack of memory. So each
    θ that it had not answered runs again, alone in its worker. If a worker dies again, that θ has
    failed.

    Args:
        task: What to do with each θ.
        jobs: Number of workers.
        timeout: Time limit of an experiment in seconds; infinite for no limit.
        ahead: Number of results that may be waiting for an earlier one.
    """

    def __init__(self, task: Task, jobs: int, timeout: float, ahead: int) -> None:
        self._task, self._jobs, self._timeout, self._ahead = packed(task), jobs, timeout, ahead
        self._bell = threading.Event()
        self._workers: list[Worker] = []
        self._thetas: dict[int, Float[np.ndarray, " n"]] = {}  # waiting or running
        self._again: deque[int] = deque()  # to run alone
        self._alone: set[int] = set()
        self._done: dict[int, Result] = {}
        self._next = self._taken = 0
        self._loads = False  # whether a worker has loaded the scenario

    def run(
        self, thetas: Iterable[Float[np.ndarray, " n"]], landed: Callable[[int], None]
    ) -> Generator[Result, None, None]:
        """Run all `thetas`, physical, each of shape (n,); yield results in order.

        Closing the generator ends the workers.

        Args:
            thetas: θ to run, read only as far as needed.
            landed: Function that is called with the number of results that have arrived.

        Raises:
            ScenarioError: If workers cannot load the scenario.
        """
        source = iter(thetas)
        try:
            while self._hand_out(source):
                self._bell.wait(self._patience())
                self._bell.clear()
                before = len(self._done)
                self._collect()
                landed(len(self._done) - before)
                while self._next in self._done:
                    yield self._done.pop(self._next)
                    self._next += 1
            self._dismiss()
        finally:
            for worker in self._workers:
                worker.life.kill()

    def _hand_out(self, source: Iterator[Float[np.ndarray, " n"]]) -> bool:
        """Give workers what they have room for; return whether any θ is running."""
        for worker in self._workers:
            if not worker.given or worker.given[0] not in self._alone:
                self._give(worker, self._chosen(source, worker.room, idle=not worker.given))
        started: list[tuple[Worker, list[int]]] = []
        while len(self._workers) < self._jobs and (chosen := self._chosen(source, 1, idle=True)):
            self._workers.append(Worker(self._timeout, self._bell))
            started.append((self._workers[-1], chosen))
        for worker, chosen in started:  # all are starting: sending a large task waits for that
            worker.life.ask(self._task)
            self._give(worker, chosen)
        return any(worker.given for worker in self._workers)

    def _give(self, worker: Worker, numbers: Sequence[int]) -> None:
        if numbers:
            worker.give(numbers, [self._thetas[number] for number in numbers])

    def _chosen(
        self, source: Iterator[Float[np.ndarray, " n"]], room: int, *, idle: bool
    ) -> list[int]:
        """Return the numbers of the next θ for a worker; those to run alone come first."""
        if self._again:
            return [self._again.popleft()] if idle else []
        first = self._taken
        for theta in islice(source, max(min(room, self._next + self._ahead - first), 0)):
            self._thetas[self._taken] = theta
            self._taken += 1
        return list(range(first, self._taken))

    def _patience(self) -> float:
        """Return how long to wait for results before looking at the workers, in seconds."""
        return max(min(_LOOK, *(worker.left for worker in self._workers)), 0.0)

    def _collect(self) -> None:
        """Take what has arrived, and replace workers that died or are late."""
        for worker in list(self._workers):
            for number, result in worker.hear():
                self._settle(number, result)
            self._loads |= worker.life.loaded
            if worker.life.gone:
                self._died(worker, worker.life.ended())
            elif worker.left <= 0 and not worker.life.loaded:
                self._died(worker, "loading the scenario took too long")
            elif worker.left <= 0:
                self._late(worker)

    def _settle(self, number: int, result: Result) -> None:
        self._done[number] = result
        del self._thetas[number]
        self._alone.discard(number)

    def _died(self, worker: Worker, words: str) -> None:
        """Run again what a dead worker had at hand, unless it was a θ that ran alone."""
        self._remove(worker)
        if not self._loads:
            raise ScenarioError(f"no process can load the scenario: {words}")
        first = worker.given[0] if worker.given else None
        if first in self._alone:
            words = f"the run crashed, and again when it ran alone: {words}"
            self._settle(first, FailedRun(self._thetas[first], "died", words))
        else:
            self._again.extend(worker.given)
            self._alone.update(worker.given)

    def _late(self, worker: Worker) -> None:
        """End a worker whose experiment takes too long. It has no other one, see `Worker`."""
        self._remove(worker)
        (number,) = worker.given
        words = f"the run took longer than {self._timeout:g} s and was ended (timeout)"
        self._settle(number, FailedRun(self._thetas[number], "late", words))

    def _remove(self, worker: Worker) -> None:
        self._workers.remove(worker)
        worker.life.kill()

    def _dismiss(self) -> None:
        """Let all workers end at the same time, so that their code can clean up at exit."""
        for worker in self._workers:
            worker.life.dismiss()
        for worker in self._workers:
            worker.life.leave()
