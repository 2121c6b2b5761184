"""Write the tables of a study as CSV or Parquet, with a dictionary of their columns."""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError
from prefcal_env.parquet import pyarrow

from .tables import (
    Column,
    StudyFile,
    Table,
    answers_of,
    experiments_of,
    finished,
    trajectory_of,
)
from .trouble import told

_PART = Column("experiment", "Number of the experiment, from 1", kind="integer")
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
        shown: dict[_Key, Column] = {}
        written = {f"experiment-{index + 1:03d}.csv": e for index, e in experiments.items()}
        for name, experiment in written.items():
            _write_csv(target / "trajectories" / name, _named(trajectory_of(experiment), shown))
        for path in (target / "trajectories").iterdir():
            if _TRAJECTORY.fullmatch(path.name) and path.name not in written:
                path.unlink()
        columns = {f"{name}.csv": table.columns for name, table in tables.items()}
        columns["trajectories"] = [*shown.values()]
        _write_csv(target / dictionary_file("csv"), dictionary(columns))
    return target


def export_parquet(study: StudyFile, folder: Path | str) -> Path:
    """Write comparisons.parquet, experiments.parquet and trajectories.parquet to `folder`.

    Columns are named without units; their fields have the metadata "unit" and "meaning", which
    dictionary-parquet.csv repeats. All trajectories are in one table, with the number of their
    experiment. The folder may exist: files of an earlier export as Parquet are replaced. Raises
    StudyError if it cannot be written, and MissingExtraError without the extra `parquet`.
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
        columns = {f"{name}.parquet": table.columns for name, table in tables.items()}
        _write_csv(target / dictionary_file("parquet"), dictionary(columns))
    return target


FORMATS: Mapping[str, Callable[[StudyFile, Path | str], Path]] = {
    "csv": export_csv,
    "parquet": export_parquet,
}
"""Formats that are folders of tables, and their functions."""


def dictionary(tables: Mapping[str, Iterable[Column]]) -> Table:
    """Return a table with a row for each column of `tables`, which are lists by file."""
    columns = [Column(name, "", kind="text") for name in ("file", "column", "unit", "type",
                                                          "meaning")]  # fmt: skip
    rows = [
        [file, column.name, column.unit or None, column.kind, column.meaning]
        for file, of_file in tables.items()
        for column in of_file
    ]
    return Table(columns, rows)


def _whole(study: StudyFile, experiments: dict[int, Any]) -> dict[str, Table]:
    """Return the tables that a study has once, by name."""
    state = study.state
    return {
        "comparisons": answers_of(state),
        "experiments": experiments_of(state, experiments),
    }


def _together(tables: Mapping[int, Table]) -> Table:
    """Return one table of all trajectories, with the number of the experiment first."""
    columns: dict[_Key, Column] = {}
    for table in tables.values():
        columns |= zip(_keys(table.columns), table.columns, strict=True)
    rows: list[list[Any]] = []
    for number, table in tables.items():
        at = {key: k for k, key in enumerate(_keys(table.columns))}
        rows += ([number, *(row[at[key]] if key in at else None for key in columns)]
                 for row in table.rows)  # fmt: skip
    return Table([_PART, *columns.values()], rows)


def _keys(columns: Iterable[Column]) -> list[_Key]:
    """Return what tells the columns of a table apart: a state and an output may share a name."""
    found: list[_Key] = []
    counts: Counter[tuple[str, str, str]] = Counter()
    for column in columns:
        about = column.name, column.unit, column.meaning
        found.append((*about, counts[about]))
        counts[about] += 1
    return found


def _named(table: Table, known: dict[_Key, Column] | None = None) -> Table:
    """Return `table` with names of their own: of equal names, later ones get a number.

    Args:
        table: Table whose columns may share names.
        known: Columns of other tables, as named there; equal columns get the same name here. New
            ones are added.
    """
    known = {} if known is None else known
    keys = _keys(table.columns)
    for key, column in zip(keys, table.columns, strict=True):
        if key not in known:
            known[key] = _unused(column, known.values())
    return Table([known[key] for key in keys], table.rows)


def _unused(column: Column, others: Collection[Column]) -> Column:
    """Return `column` with a name and a heading that none of the others has."""
    names, headings = {c.name for c in others}, {c.heading for c in others}
    found, number = column, 1
    while found.name in names or found.heading in headings:
        number += 1
        found = replace(column, name=f"{column.name} ({number})")
    return found


def _arrow(table: Table) -> Any:
    """Return a table of pyarrow, with unit and meaning in the metadata of each field."""
    pa = pyarrow()
    types = {"integer": pa.int64(), "number": pa.float64(), "text": pa.string(),
             "boolean": pa.bool_()}  # fmt: skip
    fields, arrays = [], []
    for k, column in enumerate(table.columns):
        about = {"unit": column.unit, "meaning": column.meaning}
        fields.append(pa.field(column.name, types[column.kind], metadata=about))
        try:
            arrays.append(pa.array([row[k] for row in table.rows], types[column.kind]))
        except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
            raise StudyError(f"column {column.name!r} holds no {column.kind}: {error}") from error
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _write_csv(path: Path, table: Table) -> None:
    text = io.StringIO()
    rows = ([_cell(cell) for cell in row] for row in (table.headings, *table.rows))
    csv.writer(text, lineterminator="\n").writerows(rows)
    path.write_text(text.getvalue(), encoding="utf-8")


def _cell(value: Any) -> Any:
    """Return a cell of a CSV file; text that a spreadsheet would run as a formula is escaped."""
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value
