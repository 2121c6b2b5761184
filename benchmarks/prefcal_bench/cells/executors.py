"""Run workers on this machine: a pool of processes that identifies a task whose process died."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from typing import Any, final

import numpy as np
from pebble import ProcessExpired, ProcessPool

from prefcal_env.errors import BenchmarkError, SettingsError

from .engine import running

_ATTEMPTS = 3
"""Number of consecutive pools that may break without a result."""
_PATIENCE = 2.0
"""Seconds to wait for a task whose process is gone, since its result may still arrive."""


@final
class Processes:
    """Processes on this machine, spawned so that they inherit nothing.

    Args:
        jobs: Number of processes, 1 or more.
        limit: Time limit of a task in seconds.
        last_words: Message that a process prints on standard error if this process is killed.

    Raises:
        SettingsError: If `jobs` is below 1, or `limit` is not above 0.
    """

    def __init__(self, jobs: int, *, limit: float = np.inf, last_words: str = "") -> None:
        if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
            raise SettingsError(f"jobs must be an integer, 1 or more, got {jobs!r}")
        if not limit > 0:
            raise SettingsError(f"the time limit of a cell must be above 0 s, got {limit:g}")
        self._jobs, self._limit, self._last_words = jobs, limit, last_words
        self._pool: ProcessPool | None = None
        self._others: set[BaseProcess] = set()
        self._places: list[_Place] = []
        self._pids: Any = ()
        self._broken = 0

    @property
    def serial(self) -> bool:
        """Return whether there is a single process."""
        return self._jobs == 1

    def open(self, tasks: int) -> None:
        """Start the processes, at most one per task."""
        count = min(self._jobs, tasks)
        self._others = set(multiprocessing.active_children())
        context = multiprocessing.get_context("spawn")
        self._places = [_Place() for _ in range(count)]
        self._pids = context.RawArray("q", count)
        arguments = (self._last_words, context.Lock(), self._pids)
        with _postponed():  # inherited by the pool's threads, which replace dead processes
            self._pool = ProcessPool(count, initializer=_begin, initargs=arguments, context=context)
            _ = self._pool.active  # starts it

    def width(self) -> int:
        """Return the number of processes, after giving up tasks whose process is gone."""
        alive = {process.pid for process in multiprocessing.active_children()}
        for place, pid in zip(self._places, self._pids, strict=True):
            place.look(gone=pid > 0 and pid not in alive)
            if place.succeeded:
                self._broken = 0
        return len(self._places)

    def submit(self, task: Callable[[], Any]) -> Future[Any]:
        """Start `task` in one of the processes, after replacing a broken pool."""
        if self._pool is None or not self._pool.active:
            self._broken += 1
            if self._broken > _ATTEMPTS:
                raise BenchmarkError("workers die as soon as they are started")
            before = self._places
            self.close(at_once=True)
            self.open(len(before))
            for place in before:
                place.give_up()
        assert self._pool is not None
        number = next(n for n, place in enumerate(self._places) if place.free)
        self._pids[number] = 0
        limit = self._limit if np.isfinite(self._limit) else None
        future: Future[Any] = self._pool.schedule(_run, (number, task), timeout=limit)
        self._places[number] = _Place(future)
        return future

    def close(self, *, at_once: bool) -> None:
        """Kill the processes, which an agent's leftover threads would otherwise keep alive."""
        pool: Any = self._pool  # its methods are untyped
        self._pool = None
        if pool is None:
            return
        pool.stop()
        for process in set(multiprocessing.active_children()) - self._others:
            process.kill()
        pool.join()
        for process in set(multiprocessing.active_children()) - self._others:
            process.join()

    def why(self, error: BaseException) -> str:
        """Return why a task has no result; empty if its process died."""
        if isinstance(error, (ProcessExpired, BrokenExecutor, CancelledError)):
            return ""
        if isinstance(error, TimeoutError):
            return f"it took longer than {self._limit:g} s and was ended (--cell-timeout)"
        return f"{type(error).__name__}: {error}"


class _Place:
    """Slot of one task. The pool itself does not notice a process that exits with code 0."""

    def __init__(self, future: Future[Any] | None = None) -> None:
        self._future, self._seen = future, time.monotonic()

    @property
    def free(self) -> bool:
        """Return whether no task runs here."""
        return self._future is None or self._future.done()

    @property
    def succeeded(self) -> bool:
        """Return whether the task has a result."""
        future = self._future
        return (
            future is not None and future.done() and not (future.cancelled() or future.exception())
        )

    def look(self, *, gone: bool) -> None:
        """Give up the task if its process has been gone for some time."""
        now = time.monotonic()
        if not gone:
            self._seen = now
        elif now - self._seen > _PATIENCE:
            self.give_up()

    def give_up(self) -> None:
        """Cancel the task, unless it is done."""
        if self._future is not None and self._future.cancel():
            with suppress(RuntimeError):  # the pool completed it first
                self._future.set_running_or_notify_cancel()


@contextmanager
def _postponed() -> Iterator[None]:
    """Hold back Ctrl-C; processes and threads that start inside the block have it blocked."""
    resource_tracker.ensure_running()  # starting it later would unblock the signal
    pressed: list[int] = []
    # The signal is blocked in this thread, so another thread receives it; its handler still
    # runs in the main thread.
    main = threading.current_thread() is threading.main_thread()
    before: Any = signal.signal(signal.SIGINT, lambda *_: pressed.append(1)) if main else None
    blocks = hasattr(signal, "pthread_sigmask")  # not on Windows
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if blocks else None
    try:
        yield
    finally:
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if main:
            signal.signal(signal.SIGINT, before)
        if pressed:
            signal.raise_signal(signal.SIGINT)


_PIDS: Any = None
"""Array of `Processes` that maps slots to processes, in a worker."""


def _begin(last_words: str, speaker: Any, pids: Any) -> None:
    """Prepare a worker: ignore Ctrl-C, exit with the parent, print to standard error only.

    If the parent is killed, possibly by an agent, every worker prints its current task. The worker
    that gets the lock `speaker` also prints the last words.
    """
    global _PIDS
    _PIDS = pids
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, args=(last_words, speaker), daemon=True).start()


def _run(number: int, task: Callable[[], Any]) -> Any:
    """Run `task` in a worker, in the slot with this number."""
    _PIDS[number] = os.getpid()
    return task()


def _end_with_parent(last_words: str, speaker: Any) -> None:
    """End this worker when its parent ends, so that it does not wait for tasks forever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    parent.join()
    if last_words and running():
        words = f"prefcal: {running()} was running then\n"
        first = f"\nprefcal: {last_words}\n" if speaker.acquire(block=False) else ""
        with suppress(OSError):
            os.write(2, (first + words).encode(errors="backslashreplace"))
    os._exit(1)
