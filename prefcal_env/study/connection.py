"""Connect to study files, put them safely on the disk, and say in words what went wrong."""

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import NoReturn

from prefcal_env.disk import beside, synchronize, write_new
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
def told(path: Path | str, doing: str, consequence: str = "", *, what: str = "the study") -> Iterator[None]:
    """Turn errors of SQLite and the file system inside into a StudyError.

    It says "cannot DOING WHAT PATH", for example "cannot open the study a.prefcal", why, and what
    the `consequence` is, for example "Nothing was recorded".
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


_LONGEST = 480
"""Longest path in bytes: SQLite takes 512, with the names of files that are not complete yet."""
_JOURNAL = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
_DATABASE = b"SQLite format 3\0"
"""Bytes that a journal of SQLite and a database begin with."""


def connect(path: Path | str, *, timeout: float = 5.0) -> sqlite3.Connection:
    """Connect to an SQLite file, or to ":memory:", with full synchronization; create it if absent.

    `timeout` is the longest wait for a lock of another process, in seconds.
    """
    # SQLite would take a relative path that begins with "file:" for a URI.
    place = path if path == ":memory:" else os.path.abspath(path)
    connection = sqlite3.connect(place, timeout=timeout, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA trusted_schema = OFF")
        # With a rollback journal, EXTRA keeps an answer even if the power fails at once.
        connection.execute("PRAGMA synchronous = EXTRA")
    except BaseException:
        connection.close()
        raise
    return connection


def existing(path: Path | str) -> Path:
    """Return the path of an existing study file.

    Raises:
        StudyError: If it does not exist, that cannot be checked, or a log that does not belong to
            it would overwrite it.
    """
    with told(path, "open"):
        _check_name(path)
        if not Path(path).is_file():
            raise StudyError(f"there is no study file {path}")
        refuse_foreign_logs(path)
    return Path(path)


def refuse_foreign_logs(path: Path | str) -> None:
    """Raise StudyError if there is a log beside a study that SQLite would write over it."""
    for log in left_beside(path):
        with suppress(FileNotFoundError):  # another process has just completed a step
            if log.name.endswith("-wal") or not _belongs(log.read_bytes(), path):
                _refuse(path, log)


def vacant(path: Path | str) -> Path:
    """Return the path of a file that does not exist yet.

    Raises:
        StudyError: If it or a log of an earlier file of its name exists, or that cannot be checked.
    """
    with told(path, "begin", "Nothing was recorded"):
        _check_name(path)
        if Path(path).exists():
            _refuse_to_overwrite(path)
        for log in left_beside(path):
            _refuse(path, log)
    return Path(path)


def left_beside(path: Path | str) -> list[Path]:
    """Return the logs of SQLite beside a study, which a crash leaves, unless they are empty."""
    place = os.path.realpath(path)
    found = []
    for log in (Path(f"{place}-journal"), Path(f"{place}-wal")):
        with suppress(FileNotFoundError):
            found += [log] if log.stat().st_size else []
    return found


def _refuse(path: Path | str, log: Path) -> NoReturn:
    raise StudyError(
        f"{log} does not belong to {path}: a crash left it, and its study was moved, renamed or "
        "removed since. Move it beside its study, or remove it, and try again. Nothing was changed"
    )


def _belongs(log: bytes, path: Path | str) -> bool:
    """Return whether a rollback journal belongs to the study file, in its present state.

    It holds the beginning of the file before the last change, with the number of changes so far in
    bytes 24 to 28, and what tells studies apart in bytes 60 to 64.
    """
    if not log.startswith(_JOURNAL) or place_of(path) in WRITTEN_HERE:
        return True  # SQLite ignores it, or this process is writing it
    with Path(path).open("rb") as file:
        present = file.read(100)
    start = log.find(_DATABASE)
    if start < 0:
        return log[16:20] == present[28:32]  # numbers of pages
    before = log[start : start + 100]
    changes = int.from_bytes(present[24:28], "big") - int.from_bytes(before[24:28], "big")
    return changes in (0, 1) and present[60:64] == before[60:64]


WRITTEN_HERE: set[tuple[int, int] | None] = set()
"""Files that this process has locked. Nothing else here may open and close them: on POSIX, closing
a file releases all locks that the process has on it."""


def place_of(path: Path | str) -> tuple[int, int] | None:
    """Return device and inode of a file; None if there is none."""
    try:
        found = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return found.st_dev, found.st_ino


def _check_name(path: Path | str) -> None:
    try:
        name = os.fsencode(os.path.abspath(path))
    except (UnicodeEncodeError, ValueError):
        name = b"\0"
    if b"\0" in name:
        raise StudyError(f"{str(path)!r} cannot be the name of a file")
    if len(name) > _LONGEST:
        raise StudyError(
            f"the path of the study has {len(name)} bytes, at most {_LONGEST} are possible: choose "
            f"a shorter one than {path}"
        )


@contextmanager
def complete_file(target: Path) -> Iterator[Path]:
    """Yield a path to write to; what is there in the end gets the name `target`, which is new.

    So a file of this name is always complete. Raises FileExistsError if there is one in the end.
    """
    part = beside(target)
    try:
        yield part
        publish(part, target)
    finally:
        part.unlink(missing_ok=True)


def publish(source: Path, target: Path) -> None:
    """Give `source` the name `target`. Raises FileExistsError if there is such a file."""
    try:
        os.link(source, target)
    except FileExistsError:
        _refuse_to_overwrite(target)
    except OSError:  # a file system without links
        if target.exists():
            _refuse_to_overwrite(target)
        os.rename(source, target)
    synchronize(target.parent)


def _refuse_to_overwrite(path: Path | str) -> NoReturn:
    words = "there is a file of this name already, and a study never overwrites one"
    raise FileExistsError(errno.EEXIST, words, str(path))


def save_copy(content: bytes, path: Path) -> Path:
    """Write a study under the first free name beside `path`; return the new file."""
    for number in count(1):
        target = path.with_name(f"{path.stem}-rescued{number}{path.suffix}")
        with suppress(FileExistsError):
            with complete_file(target) as part:
                write_new(part, content)
            return target
    raise AssertionError("numbers never end")
