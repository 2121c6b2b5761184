"""Guess what the columns of a table are, read them as a run, and say what was taken for what."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.errors import RecordError
from prefcal_env.experiments.end import End
from prefcal_env.tables.frame import ALLOWED, TableColumns
from prefcal_env.tables.sheet import Sheet, sheet_of
from prefcal_env.tables.timing import gap_words, gaps, instants, time_unit_of, usual_time_columns
from prefcal_env.tables.units import parts_of

from .look import run_of
from .pair import NamedRun

_MOST = 12
"""Number of columns shown if none are named: more panels are no longer readable."""


def run_from(path: Path, about: TableColumns | None = None) -> NamedRun:
    """Return the run in a file, with a sentence on what was taken for what.

    Args:
        path: CSV or Parquet file, with a heading "name" or "name [unit]" for each column.
        about: What is known of the columns: names, units, references and time. A reference is a
            number as text, or the heading of a column. The rest is found from the headings.

    Raises:
        RecordError: If the file is no table, or a column is missing or holds no numbers.
    """
    try:
        return _run_from(path, TableColumns() if about is None else about)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error


def _run_from(path: Path, about: TableColumns) -> NamedRun:
    sheet, time, mended = _timed_sheet(path, about)
    names = _names(sheet, about)
    reference = _references(sheet, about, names)
    beside = {time, *(names[name] for name in about.inputs)}
    beside |= {sheet.column(r, "") for r in reference.values() if isinstance(r, str)}
    outputs, left_out = _outputs(sheet, about, {n: i for n, i in names.items() if i not in beside})
    for name in about.reference:
        if name not in outputs:  # it would neither be drawn nor measured
            there = "an input" if name in about.inputs else "not shown"
            raise RecordError(
                f"{name!r} has a reference but is {there}: the outputs are {', '.join(outputs)}; "
                f"add it with --outputs, or leave --reference {name}=... out"
            )
    reference = {name: value for name, value in reference.items() if name in outputs}
    used = (*outputs, *about.inputs)
    # The page shows times as they are, and needs every row. Look computes KPIs of its own, and
    # nobody says that the run was unsafe.
    columns = replace(
        about,
        columns={n: h for n, h in about.columns.items() if n in used},
        time=sheet.headings[time],
        outputs=outputs,
        reference=reference,
        units={n: u for n, u in about.units.items() if n in used},
        from_zero=False,
        allow=ALLOWED,
        max_rows=None,
        kpis=None,
        end=End.TIME_UP,
    )
    experiment = columns.read(sheet, [0.0])  # θ is not known
    heading, unit = parts_of(sheet.headings[time])[0], experiment.channels.time_unit
    taken = {"outputs": outputs, "inputs": about.inputs, "references of": reference}
    words = [f"{what} {', '.join(found)}" for what, found in taken.items() if found]
    bridged = _bridged({name: sheet.numbers(names[name]) for name in used})
    said = (f"time from {heading!r} in {unit}", *words, *mended, *bridged, *left_out)
    return run_of(path.name, experiment, "; ".join(said))


def _timed_sheet(path: Path, about: TableColumns) -> tuple[Sheet, int, list[str]]:
    """Return the rows that have a time, the number of its column, and what reading will mend."""
    sheet = sheet_of(path, {*about.columns.values(), *about.outputs, *about.inputs})
    if not len(sheet.frame):
        raise RecordError("a table needs a line of headings and rows of values, got headings only")
    named = about.columns.get("time", about.time)
    time = sheet.column(named, "") if named else (usual_time_columns(sheet) or [0])[0]
    column, said = sheet.frame[time], []
    there = np.asarray(column.notna() & (column.astype(str).str.strip() != ""))
    if not there.any():
        raise RecordError(
            f"column {parts_of(sheet.headings[time])[0]!r} should hold the time but is empty: "
            "name another one with --time"
        )
    if not there.all():
        said.append(f"{(~there).sum()} of {len(there)} rows have no time and are left out")
        frame = sheet.frame[there].reset_index(drop=True)
        lines = None if sheet.lines is None else sheet.lines[there]
        sheet = replace(sheet, frame=frame, lines=lines)
    unit = time_unit_of(sheet, time, None)
    t = instants(sheet, time, unit, about.time_format)
    if (np.diff(t) < 0).any():
        said.append("rows sorted by time")
    ordered = np.unique(t)
    if repeated := len(t) - len(ordered):
        said.append(f"of rows with the same time only the last one is kept ({repeated} left out)")
    if len(long := gaps(ordered)):
        said.append(f"{gap_words(ordered, int(long[0]), unit, len(long))}: bridged")
    return sheet, time, said


def _names(sheet: Sheet, about: TableColumns) -> dict[str, int]:
    """Return the number of each column by its name; columns without a heading have none."""
    names = {name: sheet.column(heading, "") for name, heading in about.columns.items()}
    renamed = {*names.values()}
    for i, heading in enumerate(sheet.headings):
        plain = parts_of(heading)[0]
        if plain and i not in renamed:
            names.setdefault(plain, i)
    for name in (*about.outputs, *about.inputs, *about.reference):
        if name not in names:
            names[name] = sheet.column(name, "")  # says which there are
    return names


def _references(sheet: Sheet, about: TableColumns, names: Mapping[str, int]) -> dict[str, Any]:
    """Return the reference of each output: a number, or the heading of a column."""
    bases = {name: name.removesuffix(" ref") for name in names if name.endswith(" ref")}
    found: dict[str, Any] = {
        base: sheet.headings[names[name]] for name, base in bases.items() if base in names
    }
    for name, text in about.reference.items():
        try:
            found[name] = float(text)
        except ValueError:
            found[name] = sheet.headings[names[text] if text in names else sheet.column(text, "")]
    return found


def _outputs(
    sheet: Sheet, about: TableColumns, there: Mapping[str, int]
) -> tuple[tuple[str, ...], list[str]]:
    """Return the outputs among the columns that are `there`, and what was left out."""
    import pandas as pd

    if about.outputs:
        return tuple(about.outputs), []
    columns = {name: sheet.frame[i] for name, i in there.items()}
    is_numeric = pd.api.types.is_numeric_dtype
    numeric = [n for n, values in columns.items() if is_numeric(values) and values.notna().any()]
    text = [name for name in there if name not in numeric]
    for name in text:
        if sheet.is_almost_numeric(there[name]):
            sheet.numbers(there[name])  # says which cell holds no number
    if not numeric:
        headings = ", ".join(parts_of(h)[0] for h in sheet.headings)
        raise RecordError(f"there is no column of numbers beside the time, only {headings}")
    said = [f"without numbers and left out: {', '.join(text[:5])}"] if text else []
    if len(numeric) > _MOST:
        said.append(f"only the first {_MOST} of {len(numeric)} columns: choose others with --outputs")
    return tuple(numeric[:_MOST]), said


def _bridged(columns: Mapping[str, np.ndarray]) -> Iterable[str]:
    """Yield which columns have empty cells before and after their last value."""
    filled, shorter = [], []
    for name, values in columns.items():
        there = np.flatnonzero(np.isfinite(values))
        if len(there) and len(there) <= there[-1]:
            filled.append(name)
        if len(there) and there[-1] < len(values) - 1:
            shorter.append(name)
    if filled:
        yield f"empty cells filled from their neighbors in {', '.join(filled)}"
    if shorter:
        yield f"no values in the last rows of {', '.join(shorter)}"
