"""Import optional dependencies when needed, with a clear error if they are missing."""

from importlib import import_module
from typing import Any

from prefcal_env.errors import MissingExtraError


def load(module: str, extra: str) -> Any:
    """Import `module`, which the extra `extra` of prefcal-bench installs.

    Raises:
        MissingExtraError: If it is not installed, or other packages have versions that it does not
            work with.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{module} cannot be imported ({error}): pip install 'prefcal-bench[{extra}]'"
        ) from error
