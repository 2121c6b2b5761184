"""Write the tables of a study as CSV or Parquet, with a dictionary of their columns."""

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError

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

DICTIONARY = "dictionary.csv"
"""Name of the file that says what each column is."""
_PART = Column("experiment", "Number of the experiment, from 1", kind="integer")


def export_csv(study: StudyFile, folder: Path | str) -> Path:
    """Write comparisons.csv, experiments.csv and trajectories/experiment-001.csv ... to `folder`.

    Numbers have full precision and headings have units; dictionary.csv says what each column is.
    The folder may exist. Raises StudyError if it cannot be written.
    """
    target = Path(folder)
    experiments = finished(study)
    with told(target, "write", what="the folder"):
        (target / "trajectories").mkdir(parents=True, exist_ok=True)
        tables = _whole(study, experiments)
        for name, table in tables.items():
            _write_csv(target / f"{name}.csv", table)
        shown: dict[tuple[str, str, str], Column] = {}
        for index, experiment in experiments.items():
            table = trajectory_of(experiment)
            _write_csv(target / "trajectories" / f"experiment-{index + 1:03d}.csv", table)
            shown |= {_key(column): column for column in table.columns}
        columns = {f"{name}.csv": table.columns for name, table in tables.items()}
        _write_csv(target / DICTIONARY, dictionary({**columns, "trajectories": [*shown.values()]}))
    return target


def export_parquet(study: StudyFile, folder: Path | str) -> Path:
    """Write comparisons.parquet, experiments.parquet and trajectories.parquet to `folder`.

    Columns are named without units; their fields have the metadata "unit" and "meaning", which
    dictionary.csv repeats. All trajectories are in one table, with the number of their experiment.
    The folder may exist. Raises StudyError if it cannot be written.
    """
    import pyarrow.parquet as pq

    target = Path(folder)
    experiments = finished(study)
    trajectories = {i + 1: trajectory_of(e) for i, e in experiments.items()}
    tables = {**_whole(study, experiments), "trajectories": _together(trajectories)}
    with told(target, "write", what="the folder"):
        target.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            pq.write_table(_arrow(table), target / f"{name}.parquet")
        columns = {f"{name}.parquet": table.columns for name, table in tables.items()}
        _write_csv(target / DICTIONARY, dictionary(columns))
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
    columns = {_key(column): column for table in tables.values() for column in table.columns}
    rows: list[list[Any]] = []
    for number, table in tables.items():
        at = {_key(column): k for k, column in enumerate(table.columns)}
        rows += ([number, *(row[at[key]] if key in at else None for key in columns)]
                 for row in table.rows)  # fmt: skip
    return Table([_PART, *columns.values()], rows)


def _key(column: Column) -> tuple[str, str, str]:
    """Return what makes a column one of its own: a state and an output may share a name."""
    return column.name, column.unit, column.meaning


def _arrow(table: Table) -> Any:
    """Return a table of pyarrow; of columns with the same name, later ones get a number."""
    import pyarrow as pa

    types = {"integer": pa.int64(), "number": pa.float64(), "text": pa.string(),
             "boolean": pa.bool_()}  # fmt: skip
    fields, arrays, seen = [], [], dict[str, int]()
    for k, column in enumerate(table.columns):
        seen[column.name] = seen.get(column.name, 0) + 1
        name = column.name if seen[column.name] == 1 else f"{column.name} ({seen[column.name]})"
        about = {"unit": column.unit, "meaning": column.meaning}
        fields.append(pa.field(name, types[column.kind], metadata=about))
        try:
            arrays.append(pa.array([row[k] for row in table.rows], types[column.kind]))
        except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
            raise StudyError(f"column {name!r} holds no {column.kind}: {error}") from error
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
