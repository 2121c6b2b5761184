"""The tables of a study file, their version, and the way up from every older one."""

import sqlite3
from collections.abc import Iterator, Mapping

from prefcal_env.errors import StudyError

APPLICATION = 0x70726663
"""Says that an SQLite file is a study: "prfc"."""
VERSION = 1
"""Of the tables."""

TABLES = """
CREATE TABLE event (
    seq INTEGER PRIMARY KEY,
    at TEXT NOT NULL,
    kind TEXT NOT NULL,
    body TEXT NOT NULL,
    payload BLOB,
    hash TEXT NOT NULL
) STRICT;
CREATE TABLE head (
    one INTEGER PRIMARY KEY CHECK (one = 1),
    count INTEGER NOT NULL,
    hash TEXT NOT NULL
) STRICT;
CREATE TRIGGER event_is_never_changed BEFORE UPDATE ON event
BEGIN SELECT RAISE(ABORT, 'events of a study are only appended'); END;
CREATE TRIGGER event_is_never_removed BEFORE DELETE ON event
BEGIN SELECT RAISE(ABORT, 'events of a study are only appended'); END;
"""

MIGRATIONS: Mapping[int, str] = {}
"""Version to the statements that lead from it to the next. Version 1 is the first."""


def create(connection: sqlite3.Connection, start: str) -> None:
    """Make the tables in an empty file; `start` is the hash that the chain begins with."""
    connection.executescript(f"BEGIN IMMEDIATE;{TABLES}")
    connection.execute("INSERT INTO head VALUES (1, 0, ?)", (start,))
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {VERSION}")


def check(connection: sqlite3.Connection, path: str) -> int:
    """The version of a study file.

    Raises:
        StudyError: the file is another program's, or a newer prefcal's.
    """
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != APPLICATION:
        raise StudyError(f"{path} is an SQLite file, but not a study of prefcal")
    if version > VERSION:
        raise StudyError(
            f"{path} has version {version} of the study file, this prefcal knows {VERSION}: "
            "install a newer one. Nothing was changed"
        )
    return int(version)


def upgrade(
    connection: sqlite3.Connection,
    version: int,
    *,
    to: int = VERSION,
    migrations: Mapping[int, str] = MIGRATIONS,
) -> None:
    """Lead the tables from `version` to `to`, all steps in one transaction or none.

    Raises:
        StudyError: there is no way.
    """
    if version >= to:
        return
    missing = [v for v in range(version, to) if v not in migrations]
    if missing:
        raise StudyError(f"there is no way up from version {missing[0]} of the study file")
    connection.execute("BEGIN IMMEDIATE")
    try:
        # Another process may have upgraded it since `version` was read.
        (now,) = connection.execute("PRAGMA user_version").fetchone()
        for step in range(max(version, int(now)), to):
            for statement in _statements(migrations[step]):
                connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {max(to, int(now))}")
        connection.execute("COMMIT")
    except BaseException:
        connection.execute("ROLLBACK")
        raise


def _statements(script: str) -> Iterator[str]:
    """The statements of a script, one by one: `executescript` would commit before it runs them."""
    statement = ""
    for line in script.splitlines(keepends=True):
        statement += line
        if sqlite3.complete_statement(statement):  # not at a semicolon inside a trigger
            yield statement
            statement = ""
    if statement.strip():
        yield statement
