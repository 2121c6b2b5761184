"""Remove and rename study files, but never while another process uses them."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

from .connection import connect, existing, publish, vacant
from .locations import is_simulated, simulated_beside
from .trouble import open_elsewhere, told

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
    kept = simulated_beside(file)
    if is_simulated(kept):
        kept.unlink(missing_ok=True)


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
    kept, moved = simulated_beside(source), simulated_beside(target)
    if is_simulated(kept) and is_simulated(moved):
        with suppress(OSError):  # they would be simulated again
            kept.replace(moved)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Lock the file: no other process has it open or can open it inside the block."""
    with ExitStack() as opened:
        try:
            connection = opened.enter_context(closing(connect(path, timeout=_PATIENCE)))
            # In this mode, the first access locks the whole file, or fails if it is in use.
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute("COMMIT")
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise open_elsewhere(path) from error
            if code not in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
                raise
        if os.name != "posix":  # elsewhere an open file can be neither removed nor renamed
            opened.close()
        yield


def _remove_logs(path: Path) -> None:
    """Remove what SQLite may have left beside a removed file."""
    for suffix in ("-journal", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
