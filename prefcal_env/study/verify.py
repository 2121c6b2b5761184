"""Find damage in a study file."""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError

from . import schema
from .codec import decode, unpack
from .connection import existing
from .events import Event, Finished, Shown, from_text
from .fold import State, begin, step
from .trouble import told


def verify(path: Path | str) -> tuple[str, ...]:
    """Return descriptions of all damage in the study file at `path`; empty if there is none.

    This checks the file itself (SQLite's integrity check), its tables and every experiment, and
    replays all events, so it finds a missing, swapped or impossible event. It cannot find a value
    that was edited to another valid one: compare with an export kept elsewhere.

    Raises:
        StudyError: If there is no such file, it is not a study, or it cannot be read at all.
    """
    with told(existing(path), "read"), closing(sqlite3.connect(path, timeout=5.0)) as connection:
        schema.check(connection, str(path))
        try:
            connection.execute("BEGIN")  # one view of all, even if another process appends
            found = connection.execute("PRAGMA integrity_check").fetchall()
            damage = [f"the file is damaged: {words}" for (words,) in found if words != "ok"]
            changed = schema.differences(connection)
            damage += [f"{name!r} is not as prefcal created it" for name in changed]
            query = "SELECT seq, at, body, payload FROM event ORDER BY seq"
            rows = connection.execute(query).fetchall()
        except sqlite3.DatabaseError as error:
            return (f"the file is damaged: {error}",)
    return (*damage, *_payload_findings(rows), *_event_findings(rows))


def _payload_findings(rows: Sequence[tuple[Any, ...]]) -> Iterator[str]:
    for seq, _, _, payload in rows:
        try:
            if payload is not None:
                decode(unpack(payload))
        except StudyError as error:
            yield f"event {seq}: {error}"


def _event_findings(rows: Sequence[tuple[Any, ...]]) -> Iterator[str]:
    """Replay the events up to the first impossible one, since later ones depend on it."""
    state: State | None = None
    experiments: set[int] = set()
    questions: set[int] = set()
    if not rows:
        yield "there are no events"
    for expected, (seq, at, body, payload) in enumerate(rows, start=1):
        if seq != expected:
            yield f"event {expected} is missing: event {seq} follows event {expected - 1}"
            return
        try:
            event = from_text(body)
            _check_ids(event, payload is not None, experiments, questions)
            state = begin(seq, at, event) if state is None else step(state, seq, at, event)
        except StudyError as error:
            text = str(error)
            yield text if text.startswith("event") else f"event {seq}: {text}"
            return
        if payload is not None:
            experiments.add(seq)
        if isinstance(event, Shown):
            questions.add(seq)


def _check_ids(event: Event, has_payload: bool, experiments: set[int], questions: set[int]) -> None:
    """Check the events that `event` refers to by number.

    Raises:
        StudyError: If an experiment or a question is not among the earlier events.
    """
    brings = isinstance(event, Finished) and event.same_as is None
    if brings != has_payload:
        raise StudyError("a finished event, and no other, has an experiment or names another's")
    if isinstance(event, Finished) and not brings and event.same_as not in experiments:
        raise StudyError(f"event {event.same_as} has no experiment")
    if isinstance(event, Shown) and event.repeats not in {None, *questions}:
        raise StudyError(f"event {event.repeats} showed no question")
