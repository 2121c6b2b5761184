"""Where tasks run: factories of `concurrent.futures.Executor`, and what the engine must know."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
)
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, Protocol, TypeVar, final

import numpy as np

from prefcal_env.errors import SettingsError

_GRACE = 2.0
"""Seconds that processes without a task may take to end."""
_RUNNING: list[str] = []
"""In a worker: what the task is about that it runs."""
P = ParamSpec("P")
T = TypeVar("T")


class Workers(Protocol):
    """Makes executors; one is open at a time.

    A worker that dies takes its task with it, which then ends in an exception that `died`
    recognises; the engine opens another executor if the old one is `broken`.
    """

    @property
    def serial(self) -> bool:
        """Whether there is one worker on this machine: only then are times worth anything."""

    @property
    def limit(self) -> float:
        """Most seconds of a task: the worker of a longer one can be, and is, killed."""

    def width(self) -> int:
        """How many tasks can run at the same time, now.

        Raises:
            BenchmarkError: nobody is left to run any.
        """

    def open(self) -> Executor:
        """Return a new executor. Raises BenchmarkError if there is none to be had."""

    def close(self, *, at_once: bool) -> None:
        """Give the executor up; `at_once` drops what is running."""

    def died(self, error: BaseException) -> bool:
        """Whether a task ended in `error` because its worker did."""


@final
class Processes:
    """Processes on this machine, started afresh (spawned): nothing is inherited.

    Args:
        jobs: How many, 1 or more.
        limit: Most seconds of a task.
        last_words: What one of them says on standard error if this process is killed.

    Raises:
        SettingsError: `jobs` below 1, or a `limit` that is not above 0.
    """

    def __init__(self, jobs: int, *, limit: float = np.inf, last_words: str = "") -> None:
        if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
            raise SettingsError(f"jobs must be an integer, 1 or more, got {jobs!r}")
        if not limit > 0:
            raise SettingsError(f"the time limit of a cell must be above 0 s, got {limit:g}")
        self._jobs, self._limit, self._last_words = jobs, limit, last_words
        self._pool: ProcessPoolExecutor | None = None
        self._others: set[BaseProcess] = set()

    @property
    def serial(self) -> bool:
        """Whether there is one process."""
        return self._jobs == 1

    @property
    def limit(self) -> float:
        """Most seconds of a task."""
        return self._limit

    def width(self) -> int:
        """How many processes."""
        return self._jobs

    def open(self) -> Executor:
        """Return a new pool."""
        self._others = set(multiprocessing.active_children())
        context = multiprocessing.get_context("spawn")
        told = (self._last_words, context.Lock())
        self._pool = _Pool(self._jobs, mp_context=context, initializer=_begin, initargs=told)
        return self._pool

    def close(self, *, at_once: bool) -> None:
        """End the processes; `at_once` kills them.

        They are killed a little later else: what an agent has left running, a thread say, would
        keep them.
        """
        pool, self._pool = self._pool, None
        if pool is None:
            return
        processes = set(multiprocessing.active_children()) - self._others
        if not at_once:
            pool.shutdown(wait=False, cancel_futures=True)
            until = time.monotonic() + _GRACE
            for process in processes:
                process.join(max(until - time.monotonic(), 0.0))
        for process in processes:
            process.kill()
        pool.shutdown(wait=True, cancel_futures=True)
        for process in processes:  # if shutdown was asked for before, it has not waited
            process.join(_GRACE)

    def died(self, error: BaseException) -> bool:
        """Whether a process of the pool is gone; all its tasks end so."""
        return isinstance(error, (BrokenExecutor, CancelledError))


@final
class _Pool(ProcessPoolExecutor):
    """Whose processes take no notice of Ctrl-C, not even before `_begin`.

    Any of its submissions may start one; none is left half done.
    """

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        with _postponed():
            return super().submit(_called, fn, *args, **kwargs)


def _called(fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
    """In a worker: call `fn`, and remember what it is about, for the last words."""
    _RUNNING[:] = [str(about) for about in getattr(fn, "args", ())[:1]]
    return fn(*args, **kwargs)


@contextmanager
def _postponed() -> Iterator[None]:
    """Ctrl-C comes after it; processes and threads started inside begin with it blocked."""
    resource_tracker.ensure_running()  # starting it would unblock the signal
    pressed: list[int] = []
    # Blocked in this thread, the signal goes to another one, and then its handler runs in the
    # main thread all the same.
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


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _begin(last_words: str, speaker: Any) -> None:
    """In a new worker: Ctrl-C is the parent's matter, its death is ours, stdout is its own.

    If the parent is killed, the worker that gets the lock `speaker` says the last words, and each
    what it was running: an agent may have done it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, args=(last_words, speaker), daemon=True).start()


def _end_with_parent(last_words: str, speaker: Any) -> None:
    """Without it, the workers of a parent that was killed would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    parent.join()
    if last_words and _RUNNING:
        running = f"prefcal: {_RUNNING[0]} was running then\n"
        first = f"\nprefcal: {last_words}\n" if speaker.acquire(block=False) else ""
        with suppress(OSError):
            os.write(2, (first + running).encode(errors="backslashreplace"))
    os._exit(1)
