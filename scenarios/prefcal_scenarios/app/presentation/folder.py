"""Make the folder of a report and write files to it."""

import os
from pathlib import Path

from prefcal_env.errors import SettingsError


def folder_for(path: str | Path) -> Path:
    """Return the folder `path`, created with its parents if necessary.

    Raises:
        SettingsError: If it is a file, or cannot be created or written to.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise SettingsError(f"--out must be a folder, but {error.filename!r} is a file") from error
    except OSError as error:
        raise SettingsError(f"cannot make the folder {path!s}: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise SettingsError(f"cannot write into the folder {path!s}")
    return folder


def put(path: Path, content: bytes) -> None:
    """Write a file atomically: an interruption never leaves a partial file."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_bytes(content)
    os.replace(beside, path)
