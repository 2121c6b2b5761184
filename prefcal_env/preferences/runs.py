"""Run the experiments of a loop: one after the other, or several at once."""

from collections import Counter
from collections.abc import Callable, Iterator
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
R_co = TypeVar("R_co", covariant=True)
Theta = Float[np.ndarray, " n"]
Found = tuple[Query, R, R | None]
"""A query with the results of its challenger and of its incumbent."""


class Executor(Protocol):
    """What runs functions elsewhere: an executor of `concurrent.futures`, or one like it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Any:
        """Start `fn(*args)`, and return its future."""


class Runs(Protocol[R_co]):
    """The experiments of a study."""

    def next_of(self, agent: Any) -> tuple[Query, R_co, R_co | None]:
        """Return an open query whose experiments are done, after running what is missing."""


@contextmanager
def runs_of(run: Callable[[Theta], R], at_once: int, executor: Executor | None) -> Iterator[Runs[R]]:
    """Yield what runs experiments for `ask_and_tell`, whose arguments these are."""
    integer("at_once", at_once, low=1)
    if executor is not None:
        yield _AtOnce(run, int(at_once), executor)
    elif at_once == 1:
        yield _OneByOne(run)
    else:
        threads = ThreadPoolExecutor(int(at_once), "experiment")
        try:
            yield _AtOnce(run, int(at_once), threads)
        finally:
            threads.shutdown(wait=False, cancel_futures=True)


@final
class _OneByOne(Generic[R]):
    """Runs in this thread."""

    def __init__(self, run: Callable[[Theta], R]) -> None:
        self._run = run
        self._results: dict[bytes, R] = {}

    def next_of(self, agent: Any) -> Found[R]:
        query: Query = agent.ask()
        incumbent = query.incumbent
        return query, self._of(query.challenger), None if incumbent is None else self._of(incumbent)

    def _of(self, side: Suggestion) -> R:
        key = theta_key(side.theta)
        if key not in self._results:
            self._results[key] = self._run(side.theta)
        return self._results[key]


@final
class _AtOnce(Generic[R]):
    """Runs in an executor, `at_once` at the same time.

    They are known by θ, since the number of a pending sample changes until it is answered.
    """

    def __init__(self, run: Callable[[Theta], R], at_once: int, executor: Executor) -> None:
        self._run, self._at_once, self._executor = run, at_once, executor
        self._running: dict[bytes, Future[R]] = {}
        self._results: dict[bytes, R] = {}  # in the order in which they were ready
        self._landed: SimpleQueue[bytes] = SimpleQueue()
        self._started: Counter[bytes] = Counter()

    def next_of(self, agent: Any) -> Found[R]:
        queries: list[Query] = agent.ask(self._at_once)
        while (found := self._ready(queries)) is None:
            for side in (s for q in queries for s in (q.incumbent, q.challenger) if s is not None):
                self._start(side.theta)
            self._collect(self._landed.get())
        return found

    def _ready(self, queries: list[Query]) -> Found[R] | None:
        """Return the query that can be answered first; None if none can be."""
        order = {key: place for place, key in enumerate(self._results)}
        first, found = len(order), None
        for query in queries:
            keys = [theta_key(s.theta) for s in (query.challenger, query.incumbent) if s]
            if not order.keys() >= set(keys):
                continue
            place = -1 if query.further else order[keys[0]]
            if place < first:
                first, found = place, (query, [self._results[key] for key in keys])
        if found is None:
            return None
        query, results = found
        return query, results[0], results[1] if query.incumbent is not None else None

    def _start(self, theta: Theta) -> None:
        key = theta_key(theta)
        if key in self._results or key in self._running:
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
