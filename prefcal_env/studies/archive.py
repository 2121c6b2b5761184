"""A study as one JSON text, and back: for other programs, other machines and the attic."""

import json
from base64 import b64decode, b64encode
from contextlib import closing
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError

from . import schema
from .chain import START
from .codec import pack, unpack
from .connection import beside, connect, publish, vacant
from .file import StudyFile
from .trouble import told
from .verify import verify

FORMAT = 1
_KEYS = {"seq", "at", "kind", "body", "payload", "hash"}


def export_json(study: StudyFile) -> str:
    """All events with their hashes; an experiment is base64 of its zlib-compressed bytes.

    The body of an event is text, as it was hashed; docs/study_file.md describes both.
    """
    events = []
    for seq, at, kind, body, payload, hash_ in study.rows():
        encoded = None if payload is None else b64encode(payload).decode("ascii")
        events.append(
            {"seq": seq, "at": at, "kind": kind, "body": body, "payload": encoded, "hash": hash_}
        )
    content = {"prefcal study": FORMAT, "events": events}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def import_json(text: str, path: Path | str) -> Path:
    """Make a study file at `path` of what `export_json` gave. Only data: nothing is executed.

    Raises:
        StudyError: there is a file at `path`, the text is no export, or its chain of hashes does
            not hold. No file is left then.
    """
    rows = _rows(text)
    target = vacant(path)
    with told(target, "import into", "Nothing was imported"):
        target.parent.mkdir(parents=True, exist_ok=True)
        part = beside(target)
        try:
            with closing(connect(part)) as connection:
                schema.create(connection, START)
                connection.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?)", rows)
                head = (len(rows), rows[-1][-1])
                connection.execute("UPDATE head SET count = ?, hash = ?", head)
                connection.execute("COMMIT")
            findings = verify(part)
            if findings:
                raise StudyError(f"the export is not sound, nothing was imported: {findings[0]}")
            publish(part, target)
        finally:
            part.unlink(missing_ok=True)
    return target


def _rows(text: str) -> list[tuple[Any, ...]]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"this is no exported study: {error}") from error
    if not isinstance(content, dict) or content.get("prefcal study") != FORMAT:
        raise StudyError(f'this is no exported study: expected "prefcal study": {FORMAT}')
    events = content.get("events")
    if not isinstance(events, list) or not events:
        raise StudyError("this is no exported study: it holds no events")
    return [_row(number, event) for number, event in enumerate(events, start=1)]


def _row(number: int, event: Any) -> tuple[Any, ...]:
    texts = ("at", "kind", "body", "hash")
    if not isinstance(event, dict) or set(event) != _KEYS or event["seq"] != number:
        raise StudyError(f"event {number} of the export must have the fields {sorted(_KEYS)}")
    if not all(isinstance(event[key], str) for key in texts):
        raise StudyError(f"event {number} of the export: {texts} must be text")
    payload = event["payload"]
    try:
        for key in texts:
            event[key].encode()
    except UnicodeEncodeError as error:
        raise StudyError(f"event {number} of the export holds half a character") from error
    try:
        content = None if payload is None else b64decode(payload, validate=True)
        # Compressed anew: what is stored is ours, whatever was sent.
        packed = None if content is None else pack(unpack(content))
    except (ValueError, TypeError) as error:
        raise StudyError(f"event {number} of the export: payload is no base64") from error
    return number, event["at"], event["kind"], event["body"], packed, event["hash"]
