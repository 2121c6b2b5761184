"""Run the experiments of a loop: one after the other, or several at once."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, Generic, Protocol, TypeVar, final

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import integer
from prefcal_env.errors import RunError
from prefcal_env.knobs.key import theta_key
from prefcal_env.workers import ATTEMPTS

from .answer import Query, Suggestion

R = TypeVar("R")
Theta = Float[np.ndarray, " n"]


class Executor(Protocol):
    """What runs functions elsewhere: an executor of `concurrent.futures`, or one like it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Any:
        """Start `fn(*args)`, and return its future."""


@contextmanager
def runs_of(run: Callable[[Theta], R], at_once: int, executor: Executor | None) -> Iterator["Runs[R]"]:
    """Yield what runs experiments for `ask_and_tell`, whose arguments these are."""
    integer("at_once", at_once, low=1)
    if executor is not None or at_once == 1:
        yield Runs(run, int(at_once), executor)
        return
    threads = ThreadPoolExecutor(int(at_once), "experiment")
    try:
        yield Runs(run, int(at_once), threads)
    finally:
        threads.shutdown(wait=False, cancel_futures=True)


def first_ready(queries: Iterable[Query], done: Callable[[Suggestion], int | None]) -> Query | None:
    """Return the query to answer first; None if none has all its experiments.

    One about two experiments that were compared before comes first, then the one whose challenger
    was done first.

    Args:
        queries: The open queries.
        done: Function that returns the place of an experiment in the order in which they were
            done; None if it is not done.
    """
    places: list[tuple[int, Query]] = []
    for query in queries:
        place = done(query.challenger)
        if place is not None and (query.incumbent is None or done(query.incumbent) is not None):
            places.append((-1 if query.further else place, query))
    return min(places, key=lambda found: found[0])[1] if places else None


@final
class Runs(Generic[R]):
    """The experiments of a study, `at_once` at the same time in an executor, or in this thread.

    They are known by θ, since the number of a pending sample changes until it is answered.
    """

    def __init__(self, run: Callable[[Theta], R], at_once: int, executor: Executor | None) -> None:
        self._run, self._at_once, self._executor = run, at_once, executor
        self._running: dict[bytes, Future[R]] = {}
        self._results: dict[bytes, R] = {}  # in the order in which they were ready
        self._landed: SimpleQueue[bytes] = SimpleQueue()
        self._started: Counter[bytes] = Counter()

    def next_of(self, agent: Any) -> tuple[Query, R, R | None]:
        """Return an open query and the results of both sides, after running what is missing."""
        # An agent that is run in this thread need not know of several queries.
        queries: list[Query] = [agent.ask()] if self._executor is None else agent.ask(self._at_once)
        while (query := first_ready(queries, self._place)) is None:
            for side in (s for q in queries for s in (q.incumbent, q.challenger) if s is not None):
                self._start(side.theta)
            if self._running:
                self._collect(self._landed.get())
        challenger, incumbent = query.challenger, query.incumbent
        return query, self._of(challenger), None if incumbent is None else self._of(incumbent)

    def _of(self, side: Suggestion) -> R:
        return self._results[theta_key(side.theta)]

    def _place(self, side: Suggestion) -> int | None:
        key = theta_key(side.theta)
        return next((place for place, known in enumerate(self._results) if known == key), None)

    def _start(self, theta: Theta) -> None:
        key = theta_key(theta)
        if key in self._results or key in self._running:
            return
        if self._executor is None:
            self._results[key] = self._run(theta)
            return
        self._started[key] += 1
        try:
            self._running[key] = self._executor.submit(self._run, theta)
        except BrokenExecutor as error:  # it does not replace workers that died
            words = f"the workers of the experiments died: {_told(error)}"
            raise RunError(words, "died") from error
        self._running[key].add_done_callback(lambda _: self._landed.put(key))

    def _collect(self, key: bytes) -> None:
        future = self._running.pop(key)
        try:
            self._results[key] = future.result()
        except (BrokenExecutor, CancelledError) as error:
            if self._started[key] >= ATTEMPTS:
                words = f"the worker of an experiment died {ATTEMPTS} times: {_told(error)}"
                raise RunError(words, "died") from error


def _told(error: Exception) -> str:
    """Return the message of an error, or its kind if it has none."""
    return str(error) or type(error).__name__
