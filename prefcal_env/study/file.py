"""The file of a study: where it is, its tables in SQLite, and the events appended durably."""

import errno
import os
import re
import sqlite3
import struct
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import cache
from hashlib import sha256
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, Self
from zlib import crc32

import numpy as np
from jaxtyping import Float
from platformdirs import user_data_path

from prefcal_env.disk import beside, synchronize, write_new
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.knobs import theta_key

from .beside import SUFFIX, all_beside
from .fold import (
    LONGEST_HEADER,
    Created,
    Event,
    Finished,
    Recorded,
    State,
    begin,
    decode,
    encode,
    end_of,
    from_text,
    pack,
    step,
    to_text,
    unpack,
)
from .tables import frame_of, html_of

# --- Define the tables of a study file, the number of their format, and the checksums of events.

APPLICATION = 0x70726663
"""Marks an SQLite file as a study: "prfc"."""
VERSION = 3
"""Number of the format."""

TABLES = """
CREATE TABLE event (
    seq INTEGER PRIMARY KEY,
    at TEXT NOT NULL,
    body TEXT NOT NULL,
    payload BLOB,
    checksum INTEGER NOT NULL
) STRICT;
CREATE TRIGGER event_is_never_changed BEFORE UPDATE ON event
BEGIN SELECT RAISE(ABORT, 'events of a study are only appended'); END;
CREATE TRIGGER event_is_never_removed BEFORE DELETE ON event
BEGIN SELECT RAISE(ABORT, 'events of a study are only appended'); END;
"""


def create(connection: sqlite3.Connection) -> None:
    """Create the tables in an empty file, in a transaction that stays open."""
    connection.executescript(f"BEGIN IMMEDIATE;{TABLES}")
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {VERSION}")


def check(connection: sqlite3.Connection, path: str) -> None:
    """Check that a file is a study of the format that this version reads.

    Raises:
        StudyError: If the file belongs to another program, or has another format.
    """
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (stored,) = connection.execute("PRAGMA user_version").fetchone()
    version = stored % _IDS
    if application != APPLICATION:
        raise StudyError(f"{path} is an SQLite file, but not a study of prefcal")
    if version != VERSION:
        advice = "install a newer prefcal" if version > VERSION else "start the study again"
        raise StudyError(
            f"{path} has format {version} of the study file, this prefcal reads format {VERSION} "
            f"only: {advice}. Nothing was changed"
        )


def differences(connection: sqlite3.Connection) -> list[str]:
    """Return the names of the tables and triggers that are missing, changed or added."""
    expected, found = _expected(), _layout(connection)
    names = {name for name, *_ in expected ^ found}
    return sorted(str(name, "utf-8", "replace") if name else "" for name in names)


@cache
def _expected() -> frozenset[tuple[bytes, ...]]:
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as fresh:
        create(fresh)
        return _layout(fresh)


def _layout(connection: sqlite3.Connection) -> frozenset[tuple[bytes, ...]]:
    """Return name, type, table and SQL statement of each table and trigger, as bytes.

    SQLite answers from the file itself: no view or trigger of a foreign file runs here.
    """
    names = ("name", "type", "tbl_name", "sql")
    columns = ", ".join(f"CAST({name} AS BLOB)" for name in names)
    return frozenset(connection.execute(f"SELECT {columns} FROM sqlite_master"))


def insert(connection: sqlite3.Connection, recorded: Recorded, payload: bytes | None, before: int) -> int:
    """Insert an event with its packed experiment, if any, inside a transaction.

    Return its checksum, given the one of the event `before` it; 0 for the first one.
    """
    seq, at, body = recorded.seq, recorded.at, to_text(recorded.event)
    size = None if payload is None else len(payload)
    found = _checksum(seq, at.encode(), body.encode(), size, before)
    row = (seq, at, body, payload, found)
    connection.execute("INSERT INTO event VALUES (?, ?, ?, ?, ?)", row)
    if seq == 1:
        connection.execute(f"PRAGMA user_version = {VERSION + _IDS * (found % 2**23)}")
    return found


def check_experiment(seq: int, event: Event, has_payload: bool, brought: Callable[[int], bool]) -> None:
    """Check that each Finished, and no other event, has an experiment or names one.

    `brought` returns whether the earlier event of a number has an experiment.

    Raises:
        StudyError: If that is not so, or the event that it names has none.
    """
    source = event.same_as if isinstance(event, Finished) else None
    if isinstance(event, Finished) != (has_payload != (source is not None)):
        raise StudyError(
            f"event {seq} is impossible: a Finished event, and no other, has an experiment or "
            "names the event that has it"
        )
    if source is not None and not brought(source):
        raise StudyError(f"event {seq} is impossible: event {source} has no experiment")


_IDS = 256  # the last byte of SQLite's user_version is the format; the rest tells studies apart
_EVENTS = (
    "SELECT seq, CAST(at AS BLOB), CAST(body AS BLOB), length(payload), checksum FROM event ORDER BY seq"
)


def events(connection: sqlite3.Connection) -> list[tuple[Any, ...]]:
    """Return what `read_events` reads of every event; payloads stay in the file."""
    return connection.execute(_EVENTS).fetchall()


def read_events(rows: list[tuple[Any, ...]]) -> Iterator[tuple[Recorded, int]]:
    """Yield each event with its checksum, from what `events` returned.

    Raises:
        StudyError: If an event is missing or differs from what was recorded.
    """
    before = 0
    for expected, (seq, at, body, size, checksum) in enumerate(rows, start=1):
        if seq != expected:
            raise StudyError(f"event {expected} is missing")
        texts = isinstance(at, bytes) and isinstance(body, bytes)
        if not texts or checksum != _checksum(seq, at, body, size, before):
            raise StudyError(f"event {seq} is damaged: its checksum does not fit")
        try:
            event: Event = from_text(body.decode())
            yield Recorded(seq, at.decode(), event), checksum
        except (StudyError, UnicodeDecodeError) as error:
            raise StudyError(f"event {seq}: {error}") from error
        before = checksum


def _checksum(seq: int, at: bytes, body: bytes, size: int | None, before: int) -> int:
    """Return the CRC-32 of an event and all events before it.

    Of a payload it holds only the size, since the compressed payload has its own checksum.
    """
    return crc32(b"%d\n%b\n%d\n%b" % (seq, at, -1 if size is None else size, body), before)


# --- Connect to study files, put them safely on the disk, and say in words what went wrong.

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
    except (sqlite3.Error, UnicodeDecodeError, OSError) as error:
        why = _DAMAGED  # a text that SQLite returns from a damaged page cannot be decoded
        if isinstance(error, sqlite3.Error):
            code = getattr(error, "sqlite_errorcode", 0)
            why = _WORDS.get(code) or _WORDS.get(code & 0xFF) or str(error)
        elif isinstance(error, OSError):
            why = error.strerror or str(error)
        more = f". {consequence}" if consequence else ""
        raise StudyError(f"cannot {doing} {what} {path}: {why}{more}") from error


def open_elsewhere(path: Path | str) -> StudyError:
    """Return the error of a study that another process has open."""
    return StudyError(
        f"the study {path} is open in another process: close it there first (another window, "
        "command or notebook)"
    )


_LONGEST = 480  # longest path in bytes: SQLite takes 512, with the names of files that are not complete yet
_JOURNAL = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
_DATABASE = b"SQLite format 3\0"  # bytes that a journal of SQLite and a database begin with


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


@contextmanager
def _owning(path: Path | str) -> Iterator[None]:
    """Lock a file against other owners inside the block; SQLite and readers are not disturbed.

    SQLite's own lock, which other programs respect, is released for an instant at each step. On Linux this
    one lasts: it belongs to a handle of its own, even if other code closes the file meanwhile.

    Raises:
        StudyError: If somebody else owns it.
    """
    if place_of(path) in WRITTEN_HERE:
        raise open_elsewhere(path)
    handle = None
    try:
        if sys.platform == "linux":
            import fcntl

            with suppress(PermissionError):  # SQLite tells that it is read-only
                handle = os.open(path, os.O_RDWR)
            if handle is not None:
                # Far behind the bytes that SQLite locks, the last of which is a gigabyte from the start.
                lock = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 1 << 62, 1, 0)
                try:
                    fcntl.fcntl(handle, fcntl.F_OFD_SETLK, lock)
                except OSError as error:  # some disks cannot lock in this way
                    if error.errno in (errno.EACCES, errno.EAGAIN):
                        raise open_elsewhere(path) from error
        yield
    finally:
        if handle is not None:
            os.close(handle)


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


# --- Locate, remove and rename studies: by path, or by name in the user's data folder.


def data_folder() -> Path:
    """Return the folder of named studies, which may not exist yet."""
    return user_data_path("prefcal", appauthor=False) / "studies"


def study_path(name_or_path: str) -> Path:
    """Return the file of a study: a path if it has a separator or a suffix, else by name.

    Raises:
        StudyError: If the name has characters other than letters, digits, "-" and "_".
    """
    if "/" in name_or_path or "\\" in name_or_path or Path(name_or_path).suffix:
        return Path(name_or_path)
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,100}", name_or_path):
        raise StudyError(
            f"a study's name must consist of letters, digits, - and _ (a path has a / or a "
            f"suffix), got {name_or_path!r}"
        )
    return data_folder() / f"{name_or_path}{SUFFIX}"


def studies_in_data_folder() -> list[Path]:
    """Return the files of all named studies, by name."""
    return sorted(data_folder().glob(f"*{SUFFIX}"))


def make_data_folder(path: Path) -> None:
    """Create the folder of named studies if `path` is in it; other folders must exist.

    Raises:
        StudyError: If it cannot be created.
    """
    if path.parent == data_folder():
        with told(path, "begin", "Nothing was recorded"):
            path.parent.mkdir(parents=True, exist_ok=True)


_PATIENCE = 0.5  # seconds to wait for another process to release the file


def remove_study(path: Path | str) -> None:
    """Remove the study file at `path`, readable or damaged.

    Raises:
        StudyError: If there is none, another process has it open, or it cannot be removed.
    """
    file = existing(path)
    with told(file, "remove", "Nothing was removed"), _alone(file):
        file.unlink()
    _remove_logs(file)
    for _, kept in all_beside(file):
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
    theirs = dict(all_beside(target))
    for kind, kept in all_beside(source):
        with suppress(OSError, KeyError):  # it only saves time
            kept.replace(theirs[kind])


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Lock the file: no other process has it open or can open it inside the block."""
    with _owning(path), ExitStack() as opened:
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


# --- Store a study in an SQLite file, to which events are appended durably and never changed.

Entry = Event | tuple[Finished, Experiment]
Rows = list[tuple[Recorded, Experiment | None]]
Clock = Callable[[], str]
_OVERWRITTEN = (sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
"""What SQLite says of a file that something else was written to, with or without its tables."""
_UNTOUCHED = "It is damaged: nothing was changed; use an earlier copy or an export"
_UNBEGUN = State(MappingProxyType({}), "", 0)  # state before the first event


class StudyFile:
    """Open study, made by `create` or `open`. Methods can be called from any thread.

    An event is on the disk, in the study's own file, when `append` returns. The file is locked
    until `close`: others can read it, but not write to it.
    """

    def __init__(self, connection: sqlite3.Connection, path: str, clock: Clock) -> None:
        self._connection, self.path, self._clock = connection, path, clock
        self._lock = threading.RLock()
        self._last = 0  # number of the last event
        self._checksum = 0  # of the last event
        self._address = os.path.abspath(path)  # the working folder may change
        self._place: tuple[int, int] | None = None  # device and inode; None if only read
        self._owned = ExitStack()  # ends what keeps others from writing
        self._copy = connection  # in memory once it is open, should others remove or overwrite the file
        self._saved: tuple[int, Path] | None = None  # number of the last event, and the copy
        self.state = _UNBEGUN
        """State of the study after all events."""
        self._experiments: dict[bytes, int] = {}

    @classmethod
    def create(cls, path: Path | str, configuration: Mapping[str, Any], *, clock: Clock) -> Self:
        """Start a study at `path`, or in memory at ":memory:".

        Args:
            path: New file in an existing folder.
            configuration: Nested plain data, with an integer `n_max`.
            clock: Function that returns the time of an event as text.

        Raises:
            StudyError: If there is a file already, or it cannot be written.
        """
        created = Created(configuration)
        if path == ":memory:":
            file = cls(connect(":memory:"), ":memory:", clock)
            file._begin(created)
            return file
        target = vacant(path)
        with (
            told(target, "begin", "Nothing was recorded"),
            complete_file(target) as part,
            closing(connect(part)) as connection,
        ):
            cls(connection, str(part), clock)._begin(created)
        return cls.open(target, clock=clock)

    @classmethod
    def open(cls, path: Path | str, *, clock: Clock, reading: bool = False) -> Self:
        """Open the study at `path`.

        Args:
            path: Existing file.
            clock: Function that returns the time of an event as text.
            reading: Whether nothing will be appended: this works while another process has the
                study open.

        Raises:
            StudyError: If there is none, it is damaged, not a study, or of another format, or
                another process has it open, too.
        """
        with told(existing(path), "open"), ExitStack() as undo:
            connection = connect(path)
            undo.callback(connection.close)
            check(connection, str(path))
            if different := differences(connection):
                raise StudyError(f"{different[0]!r} of {path} is not as created. {_UNTOUCHED}")
            file = cls(connection, str(path), clock)
            undo.callback(file.close)
            if not reading:
                file._claim()
            file._load()
            if not reading:
                file._copy = file._owned.enter_context(closing(connect(":memory:")))
                file._copy.deserialize(connection.serialize())
            undo.pop_all()  # it stays open
        return file

    def _claim(self) -> None:
        """Lock the file for this process until it is closed, for all but readers."""
        connection = self._connection
        self._owned.enter_context(_owning(self.path))
        connection.execute("PRAGMA busy_timeout = 500")
        try:
            # Not a log that outlives a crash and holds what is missing in the file itself.
            connection.execute("PRAGMA journal_mode = DELETE")
            connection.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:
                raise open_elsewhere(self.path) from error
            raise
        connection.execute("PRAGMA busy_timeout = 5000")
        self._place = place_of(self.path)
        WRITTEN_HERE.add(self._place)

    def _begin(self, created: Created) -> None:
        create(self._connection)
        recorded = Recorded(1, self._clock(), created)
        self._insert([(recorded, None)])
        self._take(created, begin(1, recorded.at, created))
        self._connection.execute("COMMIT")

    def _load(self) -> None:
        for recorded, checksum in self._events():
            seq, at, event = recorded.seq, recorded.at, recorded.event
            unbegun = self.state is _UNBEGUN
            self._take(event, begin(seq, at, event) if unbegun else step(self.state, seq, at, event))
            self._last, self._checksum = seq, checksum
        if not self._last:
            raise StudyError(f"there are no events in {self.path}. {_UNTOUCHED}")

    def _events(self) -> Iterator[tuple[Recorded, int]]:
        with self._lock, told(self.path, "read"):
            rows = events(self._connection)
        try:
            yield from read_events(rows)
        except StudyError as error:
            raise StudyError(f"{self.path}: {error}. {_UNTOUCHED}") from error

    def _take(self, event: Event, state: State) -> None:
        """Take over the state after an event."""
        self.state = state
        if isinstance(event, Finished):
            theta = self.state.history.samples[event.index].theta
            self._experiments[theta_key(theta)] = self.state.finished[event.index]

    def events(self) -> Iterator[Recorded]:
        """Yield all events in order, without payloads."""
        return (recorded for recorded, _ in self._events())

    def experiment(self, seq: int) -> Experiment:
        """Return the experiment of event `seq`. Raises StudyError if it has none."""
        with self._lock, told(self.path, "read"):
            query = "SELECT CAST(payload AS BLOB) FROM event WHERE seq = ?"
            row = self._connection.execute(query, (seq,)).fetchone()
        if row is None or row[0] is None:
            raise StudyError(f"event {seq} of {self.path} has no experiment")
        try:
            return decode(unpack(row[0]))
        except StudyError as error:
            raise StudyError(
                f"event {seq} of {self.path}: {error}. The file is damaged there. Use an earlier "
                "copy, or start a new study with the best θ of this one: `prefcal calibrate ... "
                f"--start {self.path}:best`; `prefcal studies verify` shows what is damaged"
            ) from error

    def end(self, seq: int) -> End:
        """Return how the experiment of event `seq` ended, without reading its trajectory.

        Raises:
            StudyError: If the event has none, or it cannot be read.
        """
        with self._lock, told(self.path, "read"):
            query = "SELECT substr(CAST(payload AS BLOB), 1, ?) FROM event WHERE seq = ?"
            row = self._connection.execute(query, (LONGEST_HEADER, seq)).fetchone()
        found = None if row is None or row[0] is None else end_of(row[0])
        return self.experiment(seq).end if found is None else found

    def to_frame(self, *, answers: bool = False) -> Any:
        """Return the experiments as a pandas DataFrame: θ, KPIs, how each ended, and its marks.

        Args:
            answers: Whether to return the answers instead, one a row.
        """
        return frame_of(self, answers=answers)

    def _repr_html_(self) -> str:
        """Return how far the study is, and its experiments, for notebooks."""
        return html_of(self)

    def rows(self) -> list[tuple[Any, ...]]:
        """Return every event as it is stored: seq, at, body and payload (compressed)."""
        query = "SELECT seq, at, body, payload FROM event ORDER BY seq"
        with self._lock, told(self.path, "read"):
            return self._connection.execute(query).fetchall()

    def find_experiment(self, theta: Float[np.ndarray, " n"]) -> int | None:
        """Return the number of an event with an experiment of θ, (n,), even after an undo."""
        return self._experiments.get(theta_key(tuple(map(float, theta))))

    def append(self, *entries: Entry) -> tuple[int, ...]:
        """Record all events or none; they are durable when this returns.

        Args:
            entries: Events; a Finished with its experiment as a pair.

        Returns:
            Their numbers.

        Raises:
            StudyError: If an event is impossible in the present state, the disk is full, the file
                is read-only, or it was moved, removed, replaced or changed since it was opened.
                Nothing is recorded then. The study can still be used once the cause is gone.
        """
        pairs = [e if isinstance(e, tuple) else (e, None) for e in entries]
        with self._lock:
            first = self._last + 1
            rows: Rows = [
                (Recorded(seq, self._clock(), event), experiment)
                for seq, (event, experiment) in enumerate(pairs, start=first)
            ]
            states = [self.state]
            for r, _ in rows:
                states.append(step(states[-1], r.seq, r.at, r.event))
            try:
                with told(self.path, "write to", "Nothing was recorded"), self._holding():
                    self._check_file()
                    self._record(rows)
            finally:
                if self._last >= first:  # recorded, also if Ctrl-C came right after that
                    for (r, _), state in zip(rows, states[1:], strict=True):
                        self._take(r.event, state)
                    self._copy_new()
        return tuple(r.seq for r, _ in rows)

    def _copy_new(self) -> None:
        """Add to the copy what is new in the file: to copy all of a long study takes 20 ms and more."""
        if self._place is None:
            return
        try:
            (last,) = self._copy.execute("SELECT max(seq) FROM event").fetchone()
            new = self._connection.execute("SELECT * FROM event WHERE seq > ?", (last,))
            self._copy.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?)", new)
        except sqlite3.OperationalError:  # it grows to 1 GB only
            with suppress(sqlite3.Error):
                self._copy.deserialize(self._connection.serialize())
        except sqlite3.DatabaseError:  # of a damaged file, the copy is what is left
            pass

    def _record(self, rows: Rows) -> None:
        before = self._last, self._checksum
        try:
            self._insert(rows)
            self._connection.execute("COMMIT")
        except BaseException as error:  # Ctrl-C too: either all of it is recorded, or nothing
            after, (self._last, self._checksum) = (self._last, self._checksum), before
            if not self._has_recorded(after):
                raise
            if isinstance(error, sqlite3.Error):
                return self._confirm(after)
            self._last, self._checksum = after
            raise

    def _has_recorded(self, after: tuple[int, int]) -> bool:
        """Return whether a step that raised an error is in the file all the same."""
        try:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            return after[0] > self._last and self._tail() == after
        except sqlite3.Error:
            return False

    def _confirm(self, after: tuple[int, int]) -> None:
        """Write the folder to the disk, which failed at the end of a step."""
        try:
            synchronize(Path(os.path.realpath(self.path)).parent)
        except OSError as error:
            raise StudyError(
                f"the disk does not confirm that the last step is recorded in {self.path}: close "
                "prefcal, and open the study again to see whether it is"
            ) from error
        self._last, self._checksum = after

    @property
    def digest(self) -> str:
        """SHA-256 of the file in hexadecimal digits; to read the file itself would unlock it."""
        with self._lock, told(self.path, "read"):
            return sha256(self._connection.serialize()).hexdigest()

    @property
    def in_place(self) -> bool:
        """Return whether the file is still where it was opened."""
        return self.path == ":memory:" or place_of(self._address) == self._place

    def trouble(self) -> str | None:
        """Return why the file no longer holds everything that was recorded; None if it does.

        If it was moved, removed, replaced or overwritten, a copy is saved elsewhere.
        """
        try:
            with self._lock, told(self.path, "read"), self._holding():
                self._check_file()
        except StudyError as error:
            return str(error)
        return None

    def _check_file(self) -> None:
        """Lock the file anew, and check that it is the one that was opened and ends as it should."""
        if self.path != ":memory:":
            if self._place is None:
                raise StudyError(f"the study {self.path} was opened for reading only")
            if not self.in_place:
                raise StudyError(self._lost("moved, renamed, removed or replaced", "Move it back"))
            refuse_foreign_logs(self._address)
        try:
            same = self._is_as_recorded()
        except sqlite3.DatabaseError as error:
            if error.sqlite_errorcode & 0xFF not in _OVERWRITTEN:
                raise
            same = False
        if not same:
            raise StudyError(self._lost("changed by another program", "Restore it"))

    def _is_as_recorded(self) -> bool:
        """Lock the file anew; return whether it has the layout and the last event of this study."""
        connection = self._connection
        if connection.in_transaction and self._place is not None:
            connection.execute("ROLLBACK")
            connection.execute("PRAGMA shrink_memory")  # what others wrote is read from the disk
        if not connection.in_transaction:
            connection.execute("BEGIN IMMEDIATE")
        return not differences(connection) and self._tail() == (self._last, self._checksum)

    def _tail(self) -> Any:
        """Return number and checksum of the last event in the file; None if there is none."""
        query = "SELECT seq, checksum FROM event ORDER BY seq DESC LIMIT 1"
        return self._connection.execute(query).fetchone()

    @contextmanager
    def _holding(self) -> Iterator[None]:
        """Lock the file after a step until the next one, so that no other process can write to it."""
        try:
            yield
        finally:
            if self._place is not None and not self._connection.in_transaction:
                with suppress(sqlite3.Error):  # the next step tries again, and tells what is wrong
                    self._connection.execute("BEGIN IMMEDIATE")

    def _lost(self, what: str, remedy: str) -> str:
        """Save a copy elsewhere; return what happened and what to do."""
        lost = f"the study {self.path} was {what} while it was open. Nothing was recorded since."
        place = Path(self._address)
        for target in (place, data_folder() / place.name):
            with suppress(OSError, sqlite3.Error, StudyError):
                if self._saved is None or self._saved[0] != self._last:
                    make_data_folder(target)
                    self._saved = self._last, save_copy(self._copy.serialize(), target)
                return (
                    f"{lost} {remedy} and try again, or close prefcal and continue with a copy of "
                    f"everything before: --study {self._saved[1]}"
                )
        return f"{lost} {remedy}: it could not be saved elsewhere"

    def _insert(self, rows: Rows) -> None:
        """Insert events with their experiments, inside a transaction."""
        for recorded, experiment in rows:
            has_payload = experiment is not None
            check_experiment(recorded.seq, recorded.event, has_payload, self._payloads)
            payload = None if experiment is None else pack(encode(experiment))
            self._checksum = insert(self._connection, recorded, payload, self._checksum)
            self._last = recorded.seq

    def _payloads(self, seq: int) -> bool:
        query = "SELECT 1 FROM event WHERE seq = ? AND payload IS NOT NULL"
        return self._connection.execute(query, (seq,)).fetchone() is not None

    def close(self) -> None:
        """Close the file and release its lock."""
        with self._lock:
            self._connection.close()
            WRITTEN_HERE.discard(self._place)
            self._owned.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
