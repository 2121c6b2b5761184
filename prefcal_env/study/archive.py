"""Convert a study to one JSON text and back, for other programs, other machines and backups."""

from contextlib import closing
from pathlib import Path

import msgspec

from prefcal_env.errors import StudyError
from prefcal_env.plain import UNREADABLE, to_plain

from . import schema
from .codec import pack, unpack
from .connection import complete_file, connect, told, vacant
from .events import AnyEvent, Recorded, from_text
from .file import StudyFile
from .verify import verify

FORMAT = 2
"""Format number of the text."""


class _Row(msgspec.Struct, forbid_unknown_fields=True):
    """One event; `payload` is its experiment, zlib-compressed, in the text as base64."""

    seq: int
    at: str
    event: AnyEvent
    payload: bytes | None


class _Export(msgspec.Struct, forbid_unknown_fields=True):
    """A whole study."""

    events: list[_Row]
    format: int = msgspec.field(name="prefcal study")


class _Header(msgspec.Struct):
    """The part of an export that tells whether the rest can be read."""

    format: int = msgspec.field(name="prefcal study")


def export_json(study: StudyFile) -> str:
    """Return all events as JSON; docs/study_file.md describes it."""
    rows = [_Row(seq, at, from_text(body), payload) for seq, at, body, payload in study.rows()]
    text = msgspec.json.encode(to_plain(_Export(rows, FORMAT)))
    return msgspec.json.format(text, indent=1).decode() + "\n"


def import_json(text: str, path: Path | str) -> Path:
    """Create a study file at `path` from the text of `export_json`. Nothing in it is executed.

    Raises:
        StudyError: If there is a file at `path`, the text is not an export, or the study in it is
            damaged. No file is left then.
    """
    rows = _rows(text)
    target = vacant(path)
    with told(target, "import into", "Nothing was imported"):
        target.parent.mkdir(parents=True, exist_ok=True)
        with complete_file(target) as part:
            with closing(connect(part)) as connection:
                schema.create(connection)
                checksum = 0
                for recorded, payload in rows:
                    checksum = schema.insert(connection, recorded, payload, checksum)
                connection.execute("COMMIT")
            if findings := verify(part):
                raise StudyError(f"the export is damaged, nothing was imported: {findings[0]}")
    return target


def _rows(text: str) -> list[tuple[Recorded, bytes | None]]:
    try:
        version = msgspec.json.decode(text, type=_Header).format
        if version != FORMAT:
            raise StudyError(
                f"this is an exported study of format {version}, this prefcal reads format {FORMAT} only"
            )
        events = msgspec.json.decode(text, type=_Export).events
    except UNREADABLE as error:
        raise StudyError(f"this is not an exported study: {error}") from error
    return [_row(number, event) for number, event in enumerate(events, start=1)]


def _row(number: int, row: _Row) -> tuple[Recorded, bytes | None]:
    """Return event `number` of an export and its packed experiment."""
    if row.seq != number:
        raise StudyError(f"event {number} of the export has the number {row.seq}")
    # Decompress and compress again, to make sure that only an experiment is stored.
    packed = None if row.payload is None else pack(unpack(row.payload))
    return Recorded(number, row.at, row.event), packed
