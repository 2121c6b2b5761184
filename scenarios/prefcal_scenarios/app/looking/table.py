"""Read a run from a CSV or Parquet file of any logger, and say what was taken for what."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.errors import RecordError
from prefcal_env.experiments.recorded import recorded

from .look import run_of
from .pair import Run

_MOST = 12
"""Number of columns shown if none are named: more panels are no longer readable."""
_TIMES = ("time", "t", "timestamp", "date", "datetime")
"""Names of the column of time, in small letters; without one it is the first column."""
_TIME_UNITS = ("ms", "s", "sec", "min", "h", "d")


@dataclass(frozen=True, slots=True)
class Reading:
    """How to read tables.

    Args:
        time: Name of the column of time; "" to find it.
        outputs: Names of outputs; empty for all columns of numbers that nothing else uses.
        inputs: Names of inputs.
        reference: Maps outputs to their constant reference, or to the name of a column.
        units: Maps names to units, where the headings tell none.
        columns: Maps names to headings of the table.
    """

    time: str = ""
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    reference: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Table:
    """The columns of a table by name, and their units."""

    source: str
    columns: Mapping[str, Any]
    units: Mapping[str, str]

    def column(self, name: str) -> Any:
        if name not in self.columns:
            raise RecordError(
                f"{self.source} has no column {name!r}; there are {', '.join(self.columns)}"
            )
        return self.columns[name]

    def numbers(self, name: str) -> np.ndarray:
        import pandas as pd

        column = self.column(name)
        if not pd.api.types.is_numeric_dtype(column):
            wrong = column[pd.to_numeric(column, errors="coerce").isna() & column.notna()]
            place = f" such as {str(wrong.iloc[0])[:40]!r} in row {wrong.index[0] + 1}"
            raise RecordError(
                f"{self.source}: column {name!r} holds text{place if len(wrong) else ''}; "
                "correct it, or leave the cell empty"
            )
        return np.asarray(column, dtype=float)


def run_from(path: Path, reading: Reading | None = None, *, name: str = "") -> Run:
    """Return the run in a file, with a sentence on what was taken for what.

    Args:
        path: CSV or Parquet file, with a heading "name" or "name [unit]" for each column.
        reading: What the columns are; found from the headings if None.
        name: Name of the run; that of the file if empty.

    Raises:
        RecordError: If the file is no table, or a column is missing or holds no numbers.
    """
    reading = Reading() if reading is None else reading
    table = _table(path, reading)
    if not len(next(iter(table.columns.values()))):
        raise RecordError(f"{path} holds no row of values below its headings")
    time = _time_name(table, reading)
    t, unit = _times(table, time)
    rows, said = _sorted_rows(t)
    references = _references(table, reading)
    used = {time, *reading.inputs, *(r for r in references.values() if isinstance(r, str))}
    outputs, left_out = _outputs(table, reading, used)
    experiment = recorded(
        [0.0],  # θ is not known
        t[rows],
        outputs={n: _curve(table.numbers(n)[rows], t[rows]) for n in outputs},
        inputs={n: _curve(table.numbers(n)[rows], t[rows], held=True) for n in reading.inputs},
        reference={
            n: table.numbers(r)[rows] if isinstance(r, str) else r
            for n, r in references.items()
            if n in outputs
        },
        units={n: u for n, u in table.units.items() if n in (*outputs, *reading.inputs)},
        time_unit=unit,
        end=None,
        kpis=None,
    )
    parts = [f"time from {time!r} in {unit}", f"outputs {_listed(outputs)}"]
    parts += [f"inputs {_listed(reading.inputs)}"] if reading.inputs else []
    parts += [f"references of {_listed(list(references))}"] if references else []
    about = "; ".join([*parts, *said, *left_out])
    return run_of(name or path.name, experiment, about)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)


def _table(path: Path, reading: Reading) -> _Table:
    """Read a file; columns get the names that `reading.columns` gives to their headings."""
    frame = _frame(path)
    if all(re.fullmatch(r"[+-]?[\d.,]+([eE][+-]?\d+)?", str(h).strip()) for h in frame.columns):
        raise RecordError(
            f"{path} has numbers in its first line: add a line of headings such as "
            "'time [s],level [m]'"
        )
    ours = {heading: name for name, heading in reading.columns.items()}
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    for k, heading in enumerate(map(str, frame.columns)):
        plain, unit = _parts(heading)
        name = ours.get(heading, ours.get(plain, plain))
        if name in columns:
            raise RecordError(f"{path} has two columns {name!r}: rename one of them")
        columns[name] = frame.iloc[:, k]
        units[name] = reading.units.get(name, unit)
    missing = [h for h in reading.columns.values() if h not in frame.columns
               and h not in {_parts(str(c))[0] for c in frame.columns}]  # fmt: skip
    if missing:
        raise RecordError(
            f"{path} has no column {missing[0]!r}; there are {_listed([*map(str, frame.columns)])}"
        )
    return _Table(str(path), columns, units)


def _parts(heading: str) -> tuple[str, str]:
    """Return name and unit of a heading "name [unit]"."""
    name, bracket, unit = heading.strip().rpartition("[")
    if bracket and unit.endswith("]"):
        return name.strip(), unit[:-1].strip()
    return heading.strip(), ""


def _frame(path: Path) -> Any:
    """Return a file as a pandas DataFrame."""
    import pandas as pd

    try:
        head = path.open("rb").read(65536)
        if head[:4] == b"PAR1":
            frame = pd.read_parquet(path)
            named = frame.index.name is not None or not isinstance(frame.index, pd.RangeIndex)
            return frame.reset_index() if named else frame
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:  # pyarrow has many
        raise RecordError(f"the Parquet file {path} cannot be read: {error}") from error
    if b"\0" in head and head[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        raise RecordError(f"{path} is neither text nor Parquet: save it as CSV in UTF-8")
    encoding = "utf-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = head.decode(encoding, errors="ignore")
        lines = [line for line in text.splitlines() if line.strip() and line[0] != "#"]
        separator = max(";\t,", key=lambda mark: lines[0].count(mark)) if lines else ","
        comma = separator != "," and any("," in line for line in lines[1:])
        return pd.read_csv(
            path, sep=separator, decimal="," if comma else ".", encoding=encoding, comment="#",
            skip_blank_lines=True, skipinitialspace=True, index_col=False,
        )  # fmt: skip
    except (pd.errors.EmptyDataError, pd.errors.ParserError, UnicodeError) as error:
        why = str(error).splitlines()[0]
        raise RecordError(f"{path} is not a table with a line of headings: {why}") from error


def _time_name(table: _Table, reading: Reading) -> str:
    if reading.time:
        table.column(reading.time)
        return reading.time
    return next((n for n in table.columns if n.lower() in _TIMES), next(iter(table.columns)))


def _times(table: _Table, name: str) -> tuple[np.ndarray, str]:
    """Return the times of all rows, and their unit; time stamps count in seconds from the first."""
    import pandas as pd

    column, unit = table.column(name), table.units.get(name) or "s"
    if pd.api.types.is_numeric_dtype(column):
        return np.asarray(column, dtype=float), unit
    stamps = pd.to_datetime(column, errors="coerce", utc=True, format="ISO8601")
    wrong = column[stamps.isna() & column.notna()]
    if len(wrong):
        raise RecordError(
            f"{table.source}: column {name!r} must hold times, as numbers or as time stamps such "
            f"as 2026-01-31 12:00:00, got {str(wrong.iloc[0])[:40]!r} in row {wrong.index[0] + 1}; "
            "name the column of time with --time"
        )
    seconds = (stamps - stamps.min()).dt.total_seconds()
    return np.asarray(seconds, dtype=float), "s"


def _sorted_rows(t: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return the rows in order of time, each time once, and what was left out."""
    said = []
    rows = np.flatnonzero(np.isfinite(t))
    if len(rows) < len(t):
        said.append(f"{len(t) - len(rows)} of {len(t)} rows have no time and are left out")
    if not (np.diff(t[rows]) >= 0).all():
        rows = rows[np.argsort(t[rows], kind="stable")]
        said.append("rows sorted by time")
    last = np.append(np.diff(t[rows]) > 0, True) if len(rows) else np.zeros(0, dtype=bool)
    if not last.all():
        said.append(
            f"of rows with the same time only the last one is kept ({int((~last).sum())} left out)"
        )
    return rows[last], said


def _curve(values: np.ndarray, t: np.ndarray, *, held: bool = False) -> np.ndarray:
    """Return values with gaps closed: held for inputs, else by a line between the neighbors.

    Gaps at the end stay: the run stopped there, or so it seems.
    """
    there = np.flatnonzero(np.isfinite(values))
    if not len(there) or len(there) == len(values):
        return values
    if held:
        nearest = np.searchsorted(there, np.arange(len(values)), side="right") - 1
        closed = values[there[np.maximum(nearest, 0)]]
    else:
        closed = np.interp(t, t[there], values[there])
    return np.where(np.arange(len(values)) > there[-1], np.nan, closed)


def _references(table: _Table, reading: Reading) -> dict[str, Any]:
    """Return the reference of each output: a number, or the name of a column."""
    found: dict[str, Any] = {}
    for name in table.columns:
        if name.endswith(" ref") and name[:-4] in table.columns:
            found[name[:-4]] = name
    for name, text in reading.reference.items():
        table.column(name)
        try:
            found[name] = float(text)
        except ValueError:
            table.column(text)
            found[name] = text
    return found


def _outputs(table: _Table, reading: Reading, used: set[str]) -> tuple[tuple[str, ...], list[str]]:
    """Return the outputs, and what was left out."""
    import pandas as pd

    if reading.outputs:
        return reading.outputs, []
    there = [n for n in table.columns if n not in used]
    numeric = [n for n in there if pd.api.types.is_numeric_dtype(table.columns[n])
               and table.columns[n].notna().any()]  # fmt: skip
    said = []
    text = [n for n in there if n not in numeric]
    for name in text:
        values = pd.to_numeric(table.columns[name], errors="coerce")
        if 2 * values.notna().sum() > len(values):
            table.numbers(name)  # numbers but for a few cells: the error says which
    if not numeric:
        raise RecordError(
            f"{table.source} has no column of numbers beside the time; "
            f"there are {_listed(list(table.columns))}"
        )
    if text:
        said.append(f"without numbers and left out: {_listed(text[:5])}")
    if len(numeric) > _MOST:
        said.append(
            f"only the first {_MOST} of {len(numeric)} columns: choose others with --outputs"
        )
    return tuple(numeric[:_MOST]), said
