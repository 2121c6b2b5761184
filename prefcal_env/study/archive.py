"""Find damage in a study file, convert a study to one JSON text, and write its tables as files."""

import csv
import io
import re
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from prefcal_env.errors import StudyError
from prefcal_env.plain import UNREADABLE, to_plain
from prefcal_env.tables.sheet import pyarrow

from . import file
from .file import StudyFile, complete_file, connect, existing, told, vacant
from .fold import AnyEvent, Recorded, Shown, State, begin, decode, from_text, pack, step, unpack
from .tables import AnyStudy, Column, answers_of, experiments_of, finished, trajectory_of

# --- Write the tables of a study as CSV or Parquet, with a dictionary of their columns.

_TRAJECTORY = re.compile(r"experiment-\d{3,}\.csv")
_Key = tuple[str, str, str, int]
"""What makes a column one of its own: name, unit, meaning, and its position among equal ones."""


def dictionary_file(format: str) -> str:
    """Return the name of the file that says what each column of a format's files is."""
    return f"dictionary-{format}.csv"


def export_csv(study: AnyStudy, folder: Path | str) -> Path:
    """Write comparisons.csv, experiments.csv and trajectories/experiment-001.csv ... to `folder`.

    Numbers have full precision, headings have units, and dictionary-csv.csv says what each column
    is. The folder may exist: files of an earlier export as CSV are replaced, and its trajectories
    of experiments that this study lacks are removed. Raises StudyError if it cannot be written.
    """
    target = Path(folder)
    experiments = finished(study)
    with told(target, "write", what="the folder"):
        (target / "trajectories").mkdir(parents=True, exist_ok=True)
        tables = {name: _named(table) for name, table in _whole(study, experiments).items()}
        for name, table in tables.items():
            _write_csv(target / f"{name}.csv", table)
        shown: dict[_Key, str] = {}
        curves: dict[str, Column] = {}
        written = {f"experiment-{index + 1:03d}.csv": e for index, e in experiments.items()}
        for name, experiment in written.items():
            table = _named(trajectory_of(experiment), shown)
            curves |= {column.name: column for column in table}
            _write_csv(target / "trajectories" / name, table)
        for path in (target / "trajectories").iterdir():
            if _TRAJECTORY.fullmatch(path.name) and path.name not in written:
                path.unlink()
        files = {f"{name}.csv": table for name, table in tables.items()}
        told_of = dictionary({**files, "trajectories": [*curves.values()]})
        _write_csv(target / dictionary_file("csv"), told_of)
    return target


def export_parquet(study: AnyStudy, folder: Path | str) -> Path:
    """Write comparisons.parquet, experiments.parquet and trajectories.parquet to `folder`.

    Columns are named without units; their fields have the metadata "unit" and "meaning", which
    dictionary-parquet.csv repeats. All trajectories are in one table, with the number of their
    experiment. The folder may exist: files of an earlier export as Parquet are replaced. Raises
    StudyError if it cannot be written, and MissingExtraError without pyarrow.
    """
    write = pyarrow().parquet.write_table
    target = Path(folder)
    experiments = finished(study)
    trajectories = {i + 1: trajectory_of(e) for i, e in experiments.items()}
    whole = {**_whole(study, experiments), "trajectories": _together(trajectories)}
    tables = {name: _named(table) for name, table in whole.items()}
    with told(target, "write", what="the folder"):
        target.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            write(_arrow(table), target / f"{name}.parquet")
        files = {f"{name}.parquet": table for name, table in tables.items()}
        _write_csv(target / dictionary_file("parquet"), dictionary(files))
    return target


FORMATS: Mapping[str, Callable[[AnyStudy, Path | str], Path]] = {"csv": export_csv, "parquet": export_parquet}
"""Formats that are folders of tables, and their functions."""


def dictionary(tables: Mapping[str, Iterable[Column]]) -> list[Column]:
    """Return a table with a row for each column of `tables`, which are lists by file."""
    every = [(file, column) for file, columns in tables.items() for column in columns]
    cells: dict[str, list[Any]] = {
        "file": [file for file, _ in every],
        "column": [column.name for _, column in every],
        "unit": [column.unit or None for _, column in every],
        "type": [column.kind for _, column in every],
        "meaning": [column.meaning for _, column in every],
    }
    return [Column(name, "", values, kind="text") for name, values in cells.items()]


def _whole(study: AnyStudy, experiments: dict[int, Any]) -> dict[str, list[Column]]:
    """Return the tables that a study has once, by name."""
    state = study.state
    return {"comparisons": answers_of(state), "experiments": experiments_of(state, experiments)}


def _together(tables: Mapping[int, Sequence[Column]]) -> list[Column]:
    """Return one table of all trajectories, with the number of the experiment first."""
    keyed = {number: dict(zip(_keys(t), t, strict=True)) for number, t in tables.items()}
    counts = {number: len(table[0].values) for number, table in tables.items()}
    numbers = [number for number, count in counts.items() for _ in range(count)]
    found = [Column("experiment", "Number of the experiment, from 1", numbers, kind="integer")]
    for key, column in {k: c for table in keyed.values() for k, c in table.items()}.items():
        values: list[Any] = []
        for number, table in keyed.items():
            values += table[key].values if key in table else [None] * counts[number]
        found.append(replace(column, values=values))
    return found


def _keys(columns: Iterable[Column]) -> list[_Key]:
    """Return what tells the columns of a table apart: a state and an output may share a name."""
    found: list[_Key] = []
    counts: Counter[tuple[str, str, str]] = Counter()
    for column in columns:
        about = column.name, column.unit, column.meaning
        found.append((*about, counts[about]))
        counts[about] += 1
    return found


def _named(table: Sequence[Column], known: dict[_Key, str] | None = None) -> list[Column]:
    """Return columns with names of their own: of equal names, later ones get a number.

    Columns that other tables have, too, get the name that is `known`; new names are added to it.
    """
    known = {} if known is None else known
    found = []
    for key, column in zip(_keys(table), table, strict=True):
        taken = {*known.values()}
        taken |= {replace(column, name=n, unit=unit).heading for (_, unit, *_), n in known.items()}
        number, named = 1, column
        while key not in known and {named.name, named.heading} & taken:
            number += 1
            named = replace(column, name=f"{column.name} ({number})")
        found.append(replace(column, name=known.setdefault(key, named.name)))
    return found


def _arrow(table: Sequence[Column]) -> Any:
    """Return a table of pyarrow, with unit and meaning in the metadata of each field."""
    pa = pyarrow()
    types = {"integer": pa.int64(), "number": pa.float64(), "text": pa.string(), "boolean": pa.bool_()}
    fields, arrays = [], []
    for column in table:
        about = {"unit": column.unit, "meaning": column.meaning}
        fields.append(pa.field(column.name, types[column.kind], metadata=about))
        try:
            arrays.append(pa.array(column.values, types[column.kind]))
        except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
            raise StudyError(f"column {column.name!r} holds no {column.kind}: {error}") from error
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _write_csv(path: Path, table: Sequence[Column]) -> None:
    text = io.StringIO()
    rows = zip(*(map(_cell, (column.heading, *column.values)) for column in table), strict=True)
    csv.writer(text, lineterminator="\n").writerows(rows)
    path.write_text(text.getvalue(), encoding="utf-8")


def _cell(value: Any) -> Any:
    """Return a cell of a CSV file; text that a spreadsheet would run as a formula is escaped."""
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value


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
        file.check(connection, str(path))
        try:
            connection.execute("BEGIN")  # one view of all, even if another process appends
            changed = file.differences(connection)
            damage = [f"{name!r} is not as prefcal created it" for name in changed]
            if "event" in changed:  # it might be an endless view
                return tuple(damage)
            found = connection.execute("PRAGMA integrity_check").fetchall()
            damage += [f"the file is damaged: {words}" for (words,) in found if words != "ok"]
            rows = file.events(connection)
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
        for recorded, _ in file.read_events(rows):
            seq, at, event = recorded.seq, recorded.at, recorded.event
            file.check_experiment(seq, event, seq in payloads, experiments.__contains__)
            state = begin(seq, at, event) if state is None else step(state, seq, at, event)
            if seq in payloads:
                experiments.add(seq)
            if isinstance(event, Shown):
                if event.repeats not in {None, *questions}:
                    raise StudyError(f"event {seq}: event {event.repeats} showed no question")
                questions.add(seq)
    except StudyError as error:
        yield str(error)


# --- Convert a study to one JSON text and back, for other programs, other machines and backups.

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


class _ExportHeader(msgspec.Struct):
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
                file.create(connection)
                checksum = 0
                for recorded, payload in rows:
                    checksum = file.insert(connection, recorded, payload, checksum)
                connection.execute("COMMIT")
            if findings := verify(part):
                raise StudyError(f"the export is damaged, nothing was imported: {findings[0]}")
    return target


def _rows(text: str) -> list[tuple[Recorded, bytes | None]]:
    try:
        version = msgspec.json.decode(text, type=_ExportHeader).format
        if version != FORMAT:
            raise StudyError(
                f"this is an exported study of format {version}, this prefcal reads format {FORMAT} only"
            )
        events = msgspec.json.decode(text, type=_Export).events
    except UNREADABLE as error:
        raise StudyError(f"this is not an exported study: {error}") from error
    found: list[tuple[Recorded, bytes | None]] = []
    for number, row in enumerate(events, start=1):
        if row.seq != number:
            raise StudyError(f"event {number} of the export has the number {row.seq}")
        # Decompress and compress again, to make sure that only an experiment is stored.
        packed = None if row.payload is None else pack(unpack(row.payload))
        found.append((Recorded(number, row.at, row.event), packed))
    return found
