"""One worker process that runs many θ, as seen from prefcal."""

import pickle
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_scenarios.processes.life import Life
from prefcal_scenarios.processes.messages import Kind, Message

from .results import Result

_INSIDE = "prefcal_scenarios.many.inside"
_PERIOD = 0.05
"""Seconds after which a worker sends its results, if no experiment has a time limit."""
_AHEAD = 0.1
"""Seconds of work that a worker has at hand."""
_LOADING = 120.0
"""Minimum time limit in seconds for loading the scenario."""


@final
class Worker:
    """A process with the numbers of the θ that it has not answered, in order.

    The first thing that its `life` is asked is the packed task.

    Args:
        timeout: Time limit of an experiment in seconds; infinite for no limit.
        bell: Event that is set when there is something to `hear`.
        gentle: Whether it leaves the processor to whatever a person waits for.
    """

    def __init__(self, timeout: float, bell: threading.Event, *, gentle: bool = False) -> None:
        # With a time limit each result is sent at once: so the first of `given` is the late one.
        period = _PERIOD if timeout == np.inf else 0.0
        self.life = Life(_INSIDE, period, threads=1, bell=bell, gentle=gentle)
        self.given: deque[int] = deque()
        self.timeout, self._room = timeout, 1
        self.pace = 0.0
        """Seconds that one experiment took in its latest message."""
        self._since = time.monotonic()

    @property
    def room(self) -> int:
        """Number of θ that it can be given now."""
        return max(self._room - len(self.given), 0)

    @property
    def in_groups(self) -> bool:
        """Whether results are sent in groups, so that any of `given` may have ended it."""
        return self.timeout == np.inf

    def give(self, numbers: Sequence[int], thetas: Sequence[Float[np.ndarray, " n"]]) -> None:
        """Hand out the θ with these numbers."""
        if not self.given and self.life.loaded:
            self._since = time.monotonic()
        self.given.extend(numbers)
        self.life.ask(pickle.dumps(list(thetas)))

    def hear(self) -> list[tuple[int, Result]]:
        """Return the numbers and results that have arrived.

        Raises:
            ScenarioError: If loading the scenario raises an error in the process.
        """
        found: list[tuple[int, Result]] = []
        while (message := self.life.hear(0.0)) is not None:
            self._since = time.monotonic()
            found += self._read(message)
        return found

    def _read(self, message: Message) -> list[tuple[int, Result]]:
        kind, content = message
        if kind is Kind.ERROR:
            raise ScenarioError(
                f"the scenario cannot be loaded in another process: {content.decode()}. "
                "jobs=1 runs it in this one"
            )
        if kind is Kind.READY:
            self.life.loaded = True
            return []
        results, seconds = pickle.loads(content)
        self.pace = seconds / max(len(results), 1)
        if self.in_groups:
            self._room = max(int(_AHEAD * len(results) / max(seconds, 1e-6)), 1)
        return [(self.given.popleft(), _opened(result)) for result in results]

    @property
    def left(self) -> float:
        """Seconds until the current experiment, or loading the scenario, is too late."""
        if not self.given and self.life.loaded:
            return np.inf
        limit = self.timeout if self.life.loaded else max(self.timeout, _LOADING)
        return self._since + limit - time.monotonic()


def _opened(result: Result | bytes) -> Result:
    if not isinstance(result, bytes):
        return result
    from prefcal_env.study.codec import decode

    return decode(result)
