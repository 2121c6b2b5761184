"""Write the tables of a study as CSV or Parquet, with a dictionary of their columns."""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError
from prefcal_env.parquet import pyarrow

from .connection import told
from .tables import Column, StudyFile, answers_of, experiments_of, finished, trajectory_of

_TRAJECTORY = re.compile(r"experiment-\d{3,}\.csv")
_Key = tuple[str, str, str, int]
"""What makes a column one of its own: name, unit, meaning, and its position among equal ones."""


def dictionary_file(format: str) -> str:
    """Return the name of the file that says what each column of a format's files is."""
    return f"dictionary-{format}.csv"


def export_csv(study: StudyFile, folder: Path | str) -> Path:
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


def export_parquet(study: StudyFile, folder: Path | str) -> Path:
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


FORMATS: Mapping[str, Callable[[StudyFile, Path | str], Path]] = {
    "csv": export_csv,
    "parquet": export_parquet,
}
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


def _whole(study: StudyFile, experiments: dict[int, Any]) -> dict[str, list[Column]]:
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
