"""The way up from older versions: once, whoever else is on it, and with triggers."""

import sqlite3

from prefcal_env.studies import schema


def database():
    connection = sqlite3.connect(":memory:", isolation_level=None)
    schema.create(connection, "0")
    connection.execute("COMMIT")
    return connection


def test_an_upgrade_that_two_processes_begin_is_made_once():
    connection = database()
    steps = {1: "UPDATE head SET count = count + 1"}
    schema.upgrade(connection, 1, to=2, migrations=steps)
    schema.upgrade(connection, 1, to=2, migrations=steps)  # had read version 1 before the other
    assert connection.execute("SELECT count FROM head").fetchone() == (1,)
    assert connection.execute("PRAGMA user_version").fetchone() == (2,)


def test_an_upgrade_may_hold_a_trigger():
    connection = database()
    trigger = (
        "CREATE TRIGGER kept BEFORE DELETE ON head\nBEGIN\nSELECT RAISE(ABORT, 'no');\nEND;\n"
        "UPDATE head SET count = 5"
    )
    schema.upgrade(connection, 1, to=2, migrations={1: trigger})
    assert connection.execute("SELECT count FROM head").fetchone() == (5,)
    names = connection.execute("SELECT name FROM sqlite_master WHERE name = 'kept'").fetchall()
    assert names == [("kept",)]
