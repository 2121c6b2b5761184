"""Where tasks run: factories of `concurrent.futures.Executor`, and what the engine must know."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
)
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, Protocol, TypeVar, final

from prefcal_env.errors import SettingsError

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

    Raises:
        SettingsError: `jobs` below 1.
    """

    def __init__(self, jobs: int) -> None:
        if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
            raise SettingsError(f"jobs must be an integer, 1 or more, got {jobs!r}")
        self._jobs = jobs
        self._pool: ProcessPoolExecutor | None = None
        self._others: set[BaseProcess] = set()

    @property
    def serial(self) -> bool:
        """Whether there is one process."""
        return self._jobs == 1

    def width(self) -> int:
        """How many processes."""
        return self._jobs

    def open(self) -> Executor:
        """Return a new pool."""
        self._others = set(multiprocessing.active_children())
        context = multiprocessing.get_context("spawn")
        self._pool = _Pool(self._jobs, mp_context=context, initializer=_begin)
        return self._pool

    def close(self, *, at_once: bool) -> None:
        """End the processes; `at_once` kills them."""
        pool, self._pool = self._pool, None
        if pool is None:
            return
        if at_once:
            for process in set(multiprocessing.active_children()) - self._others:
                process.kill()
        pool.shutdown(wait=True, cancel_futures=True)

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
            return super().submit(fn, *args, **kwargs)


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


def _begin() -> None:
    """In a new worker: Ctrl-C is the parent's matter, its death is ours, stdout is its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Without it, the workers of a parent that was killed would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
