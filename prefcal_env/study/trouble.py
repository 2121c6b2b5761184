"""What SQLite complains of, in words for people."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from prefcal_env.errors import StudyError

_WORDS = {
    sqlite3.SQLITE_FULL: "the disk is full: make room, then try again",
    sqlite3.SQLITE_READONLY: "it may not be written: allow it, or copy it to where you may write",
    sqlite3.SQLITE_BUSY: "another process is writing to it: wait, or stop that one",
    sqlite3.SQLITE_LOCKED: "another process is writing to it: wait, or stop that one",
    sqlite3.SQLITE_IOERR: "the disk does not answer, or is full",
    sqlite3.SQLITE_CORRUPT: "it is damaged: take a copy from before, or an export",
    sqlite3.SQLITE_NOTADB: "it is no study file",
    sqlite3.SQLITE_CANTOPEN: "it cannot be opened: see that you may write in its folder",
}


@contextmanager
def told(
    path: Path | str, doing: str, consequence: str = "", *, what: str = "the study"
) -> Iterator[None]:
    """Turn errors of SQLite inside into a StudyError that names the file and what to do.

    Args:
        path: The file.
        doing: "open", "write to" ...
        consequence: What has become of what was to be done.
        what: The file is, before its path.

    Raises:
        StudyError: in place of any sqlite3.Error or OSError.
    """
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        why = _WORDS.get(code, str(error))
        raise StudyError(_sentence(f"{what} {path}", doing, why, consequence)) from error
    except OSError as error:
        why = error.strerror or str(error)
        raise StudyError(_sentence(f"{what} {path}", doing, why, consequence)) from error


def _sentence(what: str, doing: str, why: str, consequence: str) -> str:
    return f"cannot {doing} {what}: {why}" + (f". {consequence}" if consequence else "")
