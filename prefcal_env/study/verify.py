"""Find damage in a study file."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError

from . import schema
from .codec import decode, unpack
from .connection import connect, existing, told
from .events import Shown
from .fold import State, begin, step


def verify(path: Path | str) -> tuple[str, ...]:
    """Return descriptions of all damage in the study file at `path`; empty if there is none.

    This checks the file itself (SQLite's integrity check), its tables, the checksum of every event
    and every experiment, and replays all events, so it finds what a disk, a copy or an editor
    changed, and a missing, swapped or impossible event. It cannot find events that are missing at
    the end, nor a change made together with its checksums: keep an export elsewhere for that.

    Raises:
        StudyError: If there is no such file, it is not a study, or it cannot be read at all.
    """
    with told(existing(path), "read"), closing(connect(path)) as connection:
        schema.check(connection, str(path))
        try:
            connection.execute("BEGIN")  # one view of all, even if another process appends
            changed = schema.differences(connection)
            damage = [f"{name!r} is not as prefcal created it" for name in changed]
            if "event" in changed:  # it might be an endless view
                return tuple(damage)
            found = connection.execute("PRAGMA integrity_check").fetchall()
            damage += [f"the file is damaged: {words}" for (words,) in found if words != "ok"]
            rows = schema.events(connection)
            payloads = _payload_findings(connection)
            return (*damage, *payloads, *_event_findings(rows))
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            return (f"the file is damaged: {error}",)


def _payload_findings(connection: sqlite3.Connection) -> Iterator[str]:
    query = "SELECT seq, CAST(payload AS BLOB) FROM event WHERE payload IS NOT NULL ORDER BY seq"
    for seq, payload in connection.execute(query):
        try:
            decode(unpack(payload))
        except StudyError as error:
            yield f"event {seq}: {error}"


def _event_findings(rows: list[tuple[Any, ...]]) -> Iterator[str]:
    """Replay the events up to the first damaged or impossible one: later ones depend on it."""
    state: State | None = None
    experiments: set[int] = set()
    questions: set[int] = set()
    if not rows:
        yield "there are no events"
    payloads = {seq for seq, _, _, size, _ in rows if size is not None}
    try:
        for recorded, _ in schema.recorded(rows):
            seq, at, event = recorded.seq, recorded.at, recorded.event
            schema.check_experiment(seq, event, seq in payloads, experiments.__contains__)
            state = begin(seq, at, event) if state is None else step(state, seq, at, event)
            if seq in payloads:
                experiments.add(seq)
            if isinstance(event, Shown):
                if event.repeats not in {None, *questions}:
                    raise StudyError(f"event {seq}: event {event.repeats} showed no question")
                questions.add(seq)
    except StudyError as error:
        yield str(error)
