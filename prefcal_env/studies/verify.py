"""Finding what was changed in a study file after it was written."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from prefcal_env.errors import StudyError

from .chain import START, link
from .codec import decode, unpack
from .connection import existing
from .events import Finished, from_text
from .fold import State, begin, step
from .schema import check
from .trouble import told


def verify(path: Path | str) -> tuple[str, ...]:
    """What is wrong with the study file at `path`, in words; nothing if it is sound.

    An event that was changed, moved, added or removed breaks the chain of hashes. Whoever
    computes the whole chain anew leaves no trace here: compare with an export kept elsewhere.

    Raises:
        StudyError: there is no such file, it is no study, or cannot be read at all.
    """
    with told(existing(path), "read"), closing(sqlite3.connect(path, timeout=5.0)) as connection:
        check(connection, str(path))
        try:
            connection.execute("BEGIN")  # one view of both, whoever appends meanwhile
            rows = connection.execute(
                "SELECT seq, at, kind, body, payload, hash FROM event ORDER BY seq"
            ).fetchall()
            head = connection.execute("SELECT count, hash FROM head").fetchone()
        except sqlite3.DatabaseError as error:
            return (f"the file is damaged: {error}",)
    return tuple(_findings(rows, head))


def _findings(rows: list[tuple[object, ...]], head: tuple[object, ...] | None) -> Iterator[str]:
    before, expected = START, 0
    state: State | None = None
    sources: set[int] = set()
    sound = True
    for seq, at, kind, body, stored, hash_ in rows:
        expected += 1
        if seq != expected:
            yield f"event {expected} is missing: event {seq} stands in its place"
            expected, sound = int(str(seq)), False
        problem, payload = _payload(stored)
        if problem:
            yield f"event {seq}: {problem}"
            sound = False
        elif link(before, int(str(seq)), str(at), str(kind), str(body), payload) != hash_:
            yield f"event {seq} was changed, or what stood before it"
            sound = False
        before = str(hash_)
        if sound:
            try:
                event = from_text(str(kind), str(body))
                if payload is not None:
                    sources.add(expected)
                brings = event.same_as or expected if isinstance(event, Finished) else None
                if (payload is not None) != (brings == expected) or brings not in {None, *sources}:
                    raise StudyError(f"event {seq} has not the experiment that it should have")
                state = begin(1, str(at), event) if state is None else step(
                    state, int(str(seq)), str(at), event
                )  # fmt: skip
            except StudyError as error:
                yield str(error)
                sound = False
    if head is None or head[0] != expected:
        count = "none" if head is None else head[0]
        yield f"the last events are missing: {count} were recorded, {expected} are there"
    elif head[1] != before:
        yield "the last event was changed"


def _payload(stored: object) -> tuple[str, bytes | None]:
    """What is wrong with a payload, and its uncompressed bytes."""
    if stored is None:
        return "", None
    try:
        content = unpack(stored if isinstance(stored, bytes) else b"")
        decode(content)
    except StudyError as error:
        return str(error), None
    return "", content
