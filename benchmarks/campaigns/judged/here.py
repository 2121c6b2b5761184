"""Run the studies of a small campaign in this process, which saves starting others."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, final


@final
class Here:
    """`Workers` of the benchmark that are this process: one task at a time."""

    @property
    def serial(self) -> bool:
        """Return True: nothing else runs meanwhile."""
        return True

    def open(self, tasks: int) -> None:
        """Do nothing: there is nothing to start."""

    def width(self) -> int:
        """Return 1."""
        return 1

    def submit(self, task: Callable[[], Any]) -> Future[Any]:
        """Run `task` now, and return its result as a future that is done."""
        future: Future[Any] = Future()
        future.set_result(task())  # the benchmark's tasks return what they raise
        return future

    def close(self, *, at_once: bool) -> None:
        """Do nothing: nothing is left running."""

    def why(self, error: BaseException) -> str:
        """Return why a task has no result."""
        return f"{type(error).__name__}: {error}"
