"""Load what reads and writes Parquet, which an extra installs."""

from types import ModuleType

from prefcal_env.errors import MissingExtraError


def pyarrow() -> ModuleType:
    """Return pyarrow, with its module `parquet`.

    Raises:
        MissingExtraError: If the extra `parquet` is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError(
            "Parquet needs pyarrow: pip install 'prefcal[parquet]', or use CSV"
        ) from error
    return pyarrow  # type: ignore[no-any-return]
