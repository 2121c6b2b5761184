"""Define the tables of a study file, the number of their format, and the checksums of events."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import cache
from typing import Any
from zlib import crc32

from prefcal_env.errors import StudyError

from .events import Event, Finished, Recorded, from_text, to_text

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


_IDS = 256
"""The last byte of SQLite's user_version is the format; the rest tells studies apart."""
_EVENTS = (
    "SELECT seq, CAST(at AS BLOB), CAST(body AS BLOB), length(payload), checksum FROM event ORDER BY seq"
)


def events(connection: sqlite3.Connection) -> list[tuple[Any, ...]]:
    """Return what `recorded` reads of every event; payloads stay in the file."""
    return connection.execute(_EVENTS).fetchall()


def recorded(rows: list[tuple[Any, ...]]) -> Iterator[tuple[Recorded, int]]:
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
