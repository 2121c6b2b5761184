"""Translate errors of SQLite and the file system into messages for people."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from prefcal_env.errors import StudyError

_DAMAGED = "it is damaged: use an earlier copy or an export"
_WORDS = {
    sqlite3.SQLITE_FULL: "the disk is full: free some space and try again",
    sqlite3.SQLITE_READONLY: "it is read-only: make it writable, or copy it to another folder",
    sqlite3.SQLITE_READONLY_DBMOVED: "it was moved, renamed or removed since it was opened",
    sqlite3.SQLITE_BUSY: "another process is using it: wait, or stop that process",
    sqlite3.SQLITE_LOCKED: "another process is using it: wait, or stop that process",
    sqlite3.SQLITE_IOERR_LOCK: "its disk cannot lock files: move it to another disk",
    sqlite3.SQLITE_IOERR: "the disk does not respond, or is full",
    sqlite3.SQLITE_CORRUPT: _DAMAGED,
    sqlite3.SQLITE_NOTADB: "it is not a study file",
    sqlite3.SQLITE_CANTOPEN: "it cannot be opened: check that you can write to its folder",
}


@contextmanager
def told(
    path: Path | str, doing: str, consequence: str = "", *, what: str = "the study"
) -> Iterator[None]:
    """Turn errors of SQLite inside into a StudyError that names the file and what to do.

    Args:
        path: Path of the file.
        doing: Verb for the message, such as "open" or "write to".
        consequence: Sentence that ends the message, such as "Nothing was recorded".
        what: Noun for the message, before the path.

    Raises:
        StudyError: In place of any sqlite3.Error or OSError.
    """
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0)
        why = _WORDS.get(code) or _WORDS.get(code & 0xFF) or str(error)
        raise StudyError(_sentence(f"{what} {path}", doing, why, consequence)) from error
    except UnicodeDecodeError as error:  # a text that SQLite returns from a damaged page
        raise StudyError(_sentence(f"{what} {path}", doing, _DAMAGED, consequence)) from error
    except OSError as error:
        why = error.strerror or str(error)
        raise StudyError(_sentence(f"{what} {path}", doing, why, consequence)) from error


def open_elsewhere(path: Path | str) -> StudyError:
    """Return the error of a study that another process has open."""
    return StudyError(
        f"the study {path} is open in another process: close it there first (another window, "
        "command or notebook)"
    )


def _sentence(what: str, doing: str, why: str, consequence: str) -> str:
    return f"cannot {doing} {what}: {why}" + (f". {consequence}" if consequence else "")
