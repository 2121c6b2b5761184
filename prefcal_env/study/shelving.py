"""Remove and rename study files, but never while another process uses them."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from prefcal_env.errors import StudyError

from .connection import existing, publish, vacant
from .trouble import told

_PATIENCE = 0.5
"""Seconds to wait for another process to release the file."""


def remove_study(path: Path | str) -> None:
    """Remove the study file at `path`, readable or damaged.

    Raises:
        StudyError: If there is none, another process has it open, or it cannot be removed.
    """
    file = existing(path)
    with told(file, "remove", "Nothing was removed"), _alone(file):
        file.unlink()
    _remove_logs(file)


def rename_study(old: Path | str, new: Path | str) -> None:
    """Move the study file at `old` to the path `new`, which must not exist.

    Raises:
        StudyError: If there is no such study, `new` exists, or another process has it open.
    """
    source, target = existing(old), vacant(new)
    with told(source, "rename", "Nothing was changed"), _alone(source):
        publish(source, target)
        source.unlink(missing_ok=True)
    _remove_logs(source)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Lock the file: no other process has it open or can open it inside the block."""
    with closing(sqlite3.connect(path, timeout=_PATIENCE, isolation_level=None)) as connection:
        try:
            # In this mode, the first access locks the whole file, or fails if it is in use.
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute("COMMIT")
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise StudyError(
                    f"the study {path} is open in another process: close it there first"
                ) from error
            if code not in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
                raise
        if os.name != "posix":  # elsewhere an open file can be neither removed nor renamed
            connection.close()
        yield


def _remove_logs(path: Path) -> None:
    """Remove what SQLite may have left beside a removed file."""
    for suffix in ("-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
