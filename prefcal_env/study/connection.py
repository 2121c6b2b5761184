"""Connect to study files, and put them safely on the disk."""

import os
import secrets
import sqlite3
from pathlib import Path

from prefcal_env.errors import StudyError

from .trouble import told


def connect(path: Path | str) -> sqlite3.Connection:
    """Connect to an SQLite file with full synchronization; create it if there is none."""
    connection = sqlite3.connect(path, timeout=5.0, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA synchronous = FULL")
    return connection


def existing(path: Path | str) -> Path:
    """Return the path of an existing study file.

    Raises:
        StudyError: If it does not exist, or that cannot be checked.
    """
    with told(path, "open"):
        _check_name(path)
        if not Path(path).is_file():
            raise StudyError(f"there is no study file {path}")
    return Path(path)


def vacant(path: Path | str) -> Path:
    """Return the path of a file that does not exist yet.

    Raises:
        StudyError: If it exists, or that cannot be checked.
    """
    with told(path, "begin", "Nothing was recorded"):
        _check_name(path)
        if Path(path).exists():
            raise StudyError(f"there is a file {path} already: a study never overwrites one")
    return Path(path)


def _check_name(path: Path | str) -> None:
    try:
        known = b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:
        known = False
    if not known:
        raise StudyError(f"{str(path)!r} cannot be the name of a file")


def beside(target: Path) -> Path:
    """Return a new name next to `target` for a file that is not complete yet.

    The name is random. A process id is the same every time in a container, so a file that a
    killed process left behind would block it forever.
    """
    return target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")


def publish(source: Path, target: Path) -> None:
    """Give `source` the name `target`, never replacing an existing file."""
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if target.exists():
            raise
        os.rename(source, target)
    _synchronize(target.parent)


def _synchronize(folder: Path) -> None:
    """Write a new name to the disk; without this, a power failure could lose the file."""
    if os.name != "posix":  # elsewhere a folder cannot be opened
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
