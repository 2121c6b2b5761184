"""Make the folder of a report, check the file of a picture, and write them."""

import os
from pathlib import Path

from prefcal_env.disk import whole_file
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


def picture_at(path: str | Path) -> Path:
    """Return the file of a picture, whose folder must exist: a report has many files, this is one.

    Raises:
        SettingsError: If it is no PNG, or its folder does not exist or cannot be written to.
    """
    target = Path(path)
    if target.suffix.lower() != ".png":
        raise SettingsError(f"out must be a file that ends in .png, got {str(path)!r}")
    if not target.parent.is_dir():
        raise SettingsError(f"out must be in an existing folder, got {str(path)!r}")
    folder_for(target.parent)
    return target


def put(path: Path, content: bytes) -> None:
    """Write a file atomically: an interruption never leaves a partial file."""
    with whole_file(path) as part:
        part.write_bytes(content)
