"""Run θ in the process of the user's code, with a time limit, a stop, and recovery from crashes."""

import json
import threading
import time
from collections.abc import Callable
from typing import Any, final

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RunError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.study.codec import decode
from prefcal_env.study.spaces import knobs_as_dicts, within_as_dict
from prefcal_scenarios.processes.life import GRACE, Life
from prefcal_scenarios.processes.messages import Kind, Message

_INSIDE = "prefcal_scenarios.isolated.inside"
DEFAULT_LIMIT = 3600.0
"""Default time limit of a run in seconds, longer than most simulations."""
_LOADING = 120.0
"""Minimum time limit in seconds for loading the user's file, however short its runs are."""
_LONG = 5.0
"""Seconds after which a run that was ended counts as hanging."""
_LOOK = 1.0
"""Seconds between checks whether the process still exists."""


@final
class Worker:
    """A worker that runs one θ at a time, from any thread; other methods can be called meanwhile.

    The process is kept between runs. After a crash or an ended run, the next run gets a fresh
    process. `hangs` says that the last run had to be ended, so the next one may hang too.

    Args:
        source: Source of the scenario, path/to/own.py:NAME.
        limit: Maximum number of seconds of a run.
        clock: Monotonic clock, in seconds.
    """

    def __init__(
        self, source: str, limit: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.source, self.limit, self._clock = source, limit, clock
        self._running = threading.Lock()  # held during a run
        self._lock = threading.Lock()  # of what follows; never held for long
        self._life: Life | None = None
        self._theta: bytes | None = None
        self._due = np.inf
        self._why = "late"
        self._begun = 0.0
        self._closed = False
        self.hangs = False

    def start(self) -> None:
        """Start the process if there is none, so that it loads the user's file meanwhile."""
        with self._lock:
            if self._life is None and not self._closed:
                self._life = Life(_INSIDE, self.source, self.limit)

    def reserve(self, theta: Float[np.ndarray, " n"]) -> None:
        """Announce the next run: from now on `busy_with` says so, and `stop` stops it."""
        with self._lock:
            self._theta, self._why, self._due = theta_key(theta), "late", np.inf

    def busy_with(self, theta: Float[np.ndarray, " n"]) -> bool | None:
        """Return whether θ is running now; None if nothing is running."""
        with self._lock:
            return None if self._theta is None else self._theta == theta_key(theta)

    @property
    def is_idle(self) -> bool:
        """Return whether nothing is running."""
        with self._lock:
            return self._theta is None

    def stop(self, why: str, within: float = 0.0) -> None:
        """End the current run in `within` seconds; the run raises RunError."""
        with self._lock:
            self._stop(why, within)

    def _stop(self, why: str, within: float) -> None:
        due = self._clock() + within
        if self._theta is not None and due < self._due:
            self._due, self._why = due, why
            if self._life is not None:
                self._life.wake()

    def run(self, theta: Float[np.ndarray, " n"], seed: int, space: KnobSpace | None) -> Experiment:
        """Run θ, physical, shape (n,), in `space`, or in the scenario's space if None.

        Raises:
            RunError: If there is no experiment; the message says why.
        """
        with self._running:
            if not self.busy_with(theta):
                self.reserve(theta)
            try:
                self.start()
                life = self._life
                if life is None:
                    raise RunError("prefcal is closing", "given up")
                self._begun = self._clock()
                life.ask(_request(theta, seed, space))
                message = self._answer(life)
                self.hangs = False
            except RunError as error:
                line = self._renew()
                self.hangs = self._clock() - self._begun > _LONG
                if line:
                    raise RunError(f"{error}. It was in {line}", error.why) from None
                raise
            except BaseException:  # Ctrl-C
                self.hangs = self._clock() - self._begun > _LONG
                self._renew()
                raise
            finally:
                with self._lock:
                    self._theta = None
        return _read(message)

    def close(self) -> None:
        """End the process; nothing can run afterwards."""
        with self._lock:
            self._stop("given up", 0.0)
            self._closed, life, self._life = True, self._life, None
        if life is None:
            return
        try:
            if self._running.acquire(timeout=2 * GRACE):
                self._running.release()
                life.leave()
        finally:
            life.kill()

    def _answer(self, life: Life) -> Message:
        """Wait for the experiment or the error of the user's code.

        The time limit starts once their file is loaded.
        """
        self._limit(0.0 if life.loaded else _LOADING)
        while True:
            with self._lock:
                left, why = self._due - self._clock(), self._why
            if left <= 0:
                raise RunError(self._words(why), why)
            message = life.hear(min(left, _LOOK))
            if message is None and life.gone:
                raise RunError(f"the run crashed: {life.ended()}", "died")
            if message is not None and message[0] is Kind.READY:
                life.loaded = True
                self._limit(0.0)
            elif message is not None:
                return message

    def _limit(self, least: float) -> None:
        with self._lock:
            if self._why == "late":
                self._due = self._clock() + max(self.limit, least)

    def _words(self, why: str) -> str:
        if why == "late":
            return (
                f"the run took longer than {in_time(self.limit)} and was ended "
                "(--run-timeout allows more)"
            )
        took = in_time(max(round(self._clock() - self._begun), 1))
        if why == "stopped":
            return f"you stopped the run after {took}"
        return f"the run was ended after {took}: its result was no longer needed"

    def _renew(self) -> str:
        """End the process, start the next one, and return the user's line the old one was in."""
        with self._lock:
            life, self._life = self._life, None
        line = "" if life is None else life.end()
        self.start()
        return line


def in_time(seconds: float) -> str:
    """Return a time in words: "90 s", "10 min", "1 h"."""
    for size, unit in ((3600, "h"), (60, "min")):
        if seconds >= size and seconds % size == 0:
            return f"{seconds / size:g} {unit}"
    return f"{seconds:g} s"


def _read(message: Message) -> Experiment:
    kind, content = message
    if kind is Kind.EXPERIMENT:
        return decode(content)
    said = json.loads(content)
    raise RunError(said["words"], said["why"], said["trace"])


def _request(theta: Float[np.ndarray, " n"], seed: int, space: KnobSpace | None) -> bytes:
    return json.dumps({"theta": theta.tolist(), "seed": seed, "space": ranges_of(space)}).encode()


def ranges_of(space: KnobSpace | None) -> dict[str, Any] | None:
    """Return the ranges of a study as plain data; None for those of the scenario."""
    if space is None:
        return None
    return {"knobs": knobs_as_dicts(space), "within": within_as_dict(space)}
