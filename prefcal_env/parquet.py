"""Load pyarrow, which reads and writes Parquet; nothing else of prefcal needs it."""

from types import ModuleType

from prefcal_env.errors import MissingExtraError


def pyarrow() -> ModuleType:
    """Return pyarrow, with its module `parquet`.

    Raises:
        MissingExtraError: If pyarrow is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("Parquet needs pyarrow: pip install pyarrow, or use CSV") from error
    return pyarrow  # type: ignore[no-any-return]
