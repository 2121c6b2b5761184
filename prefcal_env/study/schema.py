"""Define the tables of a study file and the number of their format."""

import sqlite3
from contextlib import closing

from prefcal_env.errors import StudyError

APPLICATION = 0x70726663
"""Marks an SQLite file as a study: "prfc"."""
VERSION = 2
"""Number of the format."""

TABLES = """
CREATE TABLE event (
    seq INTEGER PRIMARY KEY,
    at TEXT NOT NULL,
    body TEXT NOT NULL,
    payload BLOB
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
    (version,) = connection.execute("PRAGMA user_version").fetchone()
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
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as fresh:
        create(fresh)
        expected = _layout(fresh)
    found = _layout(connection)
    names = sorted({*expected, *found})
    return [name for name in names if expected.get(name) != found.get(name)]


def _layout(connection: sqlite3.Connection) -> dict[str, str]:
    """Return the SQL statement of each table and trigger by its name."""
    query = "SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL"
    return {str(name): str(sql) for name, sql in connection.execute(query)}
