"""An existing Dask cluster as workers, for those who outgrow one machine."""

import time
from concurrent.futures import CancelledError, Executor
from typing import Any, final

from prefcal_env.errors import BenchmarkError, MissingExtraError

from .entry import is_installed

_PATIENCE = 60.0
"""Seconds without any worker after which nothing more is expected of a cluster."""


@final
class DaskCluster:
    """The workers of a Dask scheduler, which must have this prefcal installed (and own.py).

    One cell runs at a time in each worker process, so processes of one thread are best. A worker
    that dies is the scheduler's matter at first: it tries the task elsewhere, a few times.

    Args:
        address: As in tcp://host:8786.
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
        """Never: other machines may be slower, or busy."""
        return False

    @property
    def limit(self) -> float:
        """None: what a worker of a cluster runs cannot be killed from here."""
        return float("inf")

    def width(self) -> int:
        """How many worker processes, now; waits if there is none."""
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
        if self._client is None:
            return 1  # not yet asked
        try:
            if self._client.status == "running":
                return len(self._client.nthreads())
        except OSError:  # a connection that is closed, or no answer in time
            pass
        raise BenchmarkError(f"the Dask scheduler at {self._address} is gone")

    def open(self) -> Executor:
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
        executor: Executor = self._executor
        return executor

    def close(self, *, at_once: bool) -> None:
        """Disconnect; `at_once` cancels what has not begun. The cluster itself stays."""
        client, self._client = self._client, None
        if client is not None:
            self._executor.shutdown(wait=not at_once)
            client.close()

    def died(self, error: BaseException) -> bool:
        """Whether the scheduler has given a task up because workers died of it."""
        from distributed import KilledWorker

        return isinstance(error, (KilledWorker, CancelledError))
