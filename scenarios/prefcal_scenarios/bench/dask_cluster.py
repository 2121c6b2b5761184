"""An existing Dask cluster as workers, for benchmarks too large for one machine."""

import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any, final

from prefcal_env.errors import BenchmarkError, MissingExtraError

from .roster import is_installed

_PATIENCE = 60.0
"""Seconds without any worker after which nothing more is expected of a cluster."""


@final
class DaskCluster:
    """The workers of a Dask scheduler, which must have this prefcal installed (and own.py).

    One cell runs at a time in each worker process, so processes of one thread are best. A worker
    that dies is up to the scheduler at first: it tries the task elsewhere, a few times.

    Args:
        address: Address of the scheduler, as in tcp://host:8786.
        patience: Seconds to wait for the first worker, or for another when all are gone.

    Raises:
        MissingExtraError: Dask's distributed is not installed.
    """

    def __init__(self, address: str, patience: float = _PATIENCE) -> None:
        if not is_installed("distributed"):
            raise MissingExtraError("--dask needs distributed: pip install 'prefcal[dask]'")
        self._address, self._patience = address, patience
        self._client: Any = None
        self._executor: Any = None

    @property
    def serial(self) -> bool:
        """Whether times are comparable: never, other machines may be slower, or busy."""
        return False

    def width(self) -> int:
        """Return the number of worker processes, now; wait if there is none."""
        until = time.monotonic() + self._patience
        while not (count := self._count()):
            if time.monotonic() > until:
                raise BenchmarkError(
                    f"the Dask cluster at {self._address} has had no worker for "
                    f"{self._patience:g} s"
                )
            time.sleep(0.2)
        return count

    def _count(self) -> int:
        try:
            if self._client.status == "running":
                return len(self._client.nthreads())
        except OSError:  # a connection that is closed, or no answer in time
            pass
        raise BenchmarkError(f"the Dask scheduler at {self._address} is gone")

    def open(self, tasks: int) -> None:
        """Connect to the scheduler."""
        import distributed

        connect: Any = distributed.Client  # untyped
        try:
            self._client = connect(self._address, timeout=10, set_as_default=False)
        except (OSError, ValueError) as error:  # no answer in time is an OSError, too
            raise BenchmarkError(
                f"there is no Dask scheduler at {self._address!r}: {error}"
            ) from error
        self._executor = self._client.get_executor(pure=False)

    def submit(self, task: Callable[[], Any]) -> Future[Any]:
        """Start `task` on the cluster."""
        future: Future[Any] = self._executor.submit(task)
        return future

    def close(self, *, at_once: bool) -> None:
        """Disconnect; `at_once` cancels what has not begun. The cluster itself stays."""
        client, self._client = self._client, None
        if client is not None:
            self._executor.shutdown(wait=not at_once)
            client.close()

    def why(self, error: BaseException) -> str:
        """Return why a task has no result; empty if workers died of it, time and again."""
        from distributed import KilledWorker

        died = isinstance(error, (KilledWorker, CancelledError))
        return "" if died else f"{type(error).__name__}: {error}"
