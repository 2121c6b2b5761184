"""Linear algebra on one thread: at 50 samples, two of them took three to four times as long."""

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> Any:
    # Looks through all loaded libraries, so once; numpy's and scipy's are loaded by then.
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


def one_thread() -> AbstractContextManager[Any]:
    """Inside, numpy's and scipy's linear algebra keep to one thread."""
    limit: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limit
