"""Use an existing Dask cluster as workers, for benchmarks too large for one machine."""

import logging
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any, final

from prefcal_env.errors import BenchmarkError, MissingExtraError

from .roster import is_installed

_PATIENCE = 60.0
"""Default time without any worker before the cluster is given up, in seconds."""


@final
class DaskCluster:
    """Workers of a Dask scheduler, which need the same prefcal (and own.py).

    Each worker process runs one cell at a time, so single-threaded processes are best. If a
    worker dies, the scheduler first retries the task elsewhere a few times.

    Args:
        address: Address of the scheduler, such as tcp://host:8786.
        patience: Time to wait for the first worker, or for a new one when all are gone, in
            seconds.

    Raises:
        MissingExtraError: If Dask's distributed is not installed.
    """

    def __init__(self, address: str, patience: float = _PATIENCE) -> None:
        if not is_installed("distributed"):
            raise MissingExtraError("--dask needs distributed: pip install 'prefcal[dask]'")
        self._address, self._patience = address, patience
        self._client: Any = None
        self._executor: Any = None

    @property
    def serial(self) -> bool:
        """Return False: times on different machines are not comparable."""
        return False

    def width(self) -> int:
        """Return the current number of worker processes; wait if there is none."""
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
        except OSError:  # a closed connection, or a timeout
            pass
        raise BenchmarkError(f"the Dask scheduler at {self._address} is gone")

    def open(self, tasks: int) -> None:
        """Connect to the scheduler."""
        import distributed

        # It logs tracebacks if the scheduler is lost, which `width` tells in one sentence.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        connect: Any = distributed.Client  # untyped
        try:
            self._client = connect(self._address, timeout=10, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError, too
            raise BenchmarkError(
                f"there is no Dask scheduler at {self._address!r}: {error}"
            ) from error
        self._executor = self._client.get_executor(pure=False)

    def submit(self, task: Callable[[], Any]) -> Future[Any]:
        """Start `task` on the cluster."""
        future: Future[Any] = self._executor.submit(task)
        return future

    def close(self, *, at_once: bool) -> None:
        """Disconnect; `at_once` cancels tasks that have not started. The cluster keeps running."""
        client, self._client = self._client, None
        if client is not None:
            self._executor.shutdown(wait=not at_once)
            client.close()

    def why(self, error: BaseException) -> str:
        """Return why a task has no result; empty if it repeatedly killed its worker."""
        from distributed import KilledWorker

        died = isinstance(error, (KilledWorker, CancelledError))
        return "" if died else f"{type(error).__name__}: {error}"
