"""Files and connections: how a study comes to be on the disk, and stays there."""

import os
import secrets
import sqlite3
from pathlib import Path

from prefcal_env.errors import StudyError

from .trouble import told


def connect(path: Path | str) -> sqlite3.Connection:
    """Connect to an SQLite file, making it where there is none; full synchronisation."""
    connection = sqlite3.connect(path, timeout=5.0, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA synchronous = FULL")
    return connection


def existing(path: Path | str) -> Path:
    """The path of a file that is there.

    Raises:
        StudyError: it is not, or nobody can tell.
    """
    with told(path, "open"):
        _check_name(path)
        if not Path(path).is_file():
            raise StudyError(f"there is no study file {path}")
    return Path(path)


def vacant(path: Path | str) -> Path:
    """The path of a file that is not there yet.

    Raises:
        StudyError: it is, or nobody can tell.
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
    """A name next to `target` for a file that is not whole yet, never used before.

    Not by process id: in a container it is the same every time, and what a kill left behind would
    be in the way for ever.
    """
    return target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")


def publish(source: Path, target: Path) -> None:
    """Give `source` the name `target`, never in place of a file that is there."""
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if target.exists():
            raise
        os.rename(source, target)
    _synchronise(target.parent)


def _synchronise(folder: Path) -> None:
    """Put a new name on the disk: without this, a power failure could take the file with it."""
    if os.name != "posix":  # elsewhere a folder cannot be opened
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
