"""Guess what the columns of a table are, read them as a run, and say what was taken for what."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.errors import RecordError
from prefcal_env.experiments.end import End
from prefcal_env.tables.frame import ALLOWED, TableColumns
from prefcal_env.tables.sheet import Sheet, sheet_of
from prefcal_env.tables.timing import (
    gap_words,
    gaps,
    instants,
    time_unit_of,
    usual_time_columns,
)
from prefcal_env.tables.units import parts_of

from .look import run_of
from .pair import Run

_MOST = 12
"""Number of columns shown if none are named: more panels are no longer readable."""


def run_from(path: Path, about: TableColumns | None = None) -> Run:
    """Return the run in a file, with a sentence on what was taken for what.

    Args:
        path: CSV or Parquet file, with a heading "name" or "name [unit]" for each column.
        about: What is known of the columns: names, units, references and time. A reference is a
            number as text, or the heading of a column. The rest is found from the headings.

    Raises:
        RecordError: If the file is no table, or a column is missing or holds no numbers.
    """
    try:
        guess = _Guess.of(path, TableColumns() if about is None else about)
        # θ is not known.
        experiment = guess.columns().read(guess.sheet, [0.0])
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    return run_of(path.name, experiment, guess.words())


@dataclass(frozen=True, slots=True)
class _Guess:
    """What the columns of a table are taken for.

    Args:
        sheet: The rows that have a time.
        about: What is known of the columns.
        time: Number of the column of time.
        reference: Maps outputs to their constant reference, or to the heading of a column.
        outputs: Names of the outputs.
        said: What was mended or left out.
    """

    sheet: Sheet
    about: TableColumns
    time: int
    reference: Mapping[str, Any]
    outputs: tuple[str, ...]
    said: tuple[str, ...]

    @classmethod
    def of(cls, path: Path, about: TableColumns) -> "_Guess":
        """Read the file and guess."""
        heading = about.columns.get("time", about.time)
        sheet = sheet_of(path, {*about.columns.values(), *about.outputs, *about.inputs})
        if not len(sheet.frame):
            raise RecordError(
                "a table needs a line of headings and rows of values, got headings only"
            )
        usual = [] if heading else usual_time_columns(sheet)
        time = sheet.column(heading, "") if heading else (usual or [0])[0]
        sheet, mended = _timed(sheet, time, about.time_format)
        names = _names(sheet, about)
        reference = _references(sheet, about, names)
        used = {time, *(names[n] for n in about.inputs)}
        used |= {sheet.column(r, "") for r in reference.values() if isinstance(r, str)}
        outputs, left_out = _outputs(sheet, about, names, used)
        _check_references(about, outputs)
        return cls(
            sheet, about, time, {n: r for n, r in reference.items() if n in outputs}, outputs,
            (*mended, *_bridged(sheet, (*outputs, *about.inputs), names), *left_out),
        )  # fmt: skip

    def columns(self) -> TableColumns:
        """Return how to read the table; the page shows times as they are, and needs every row."""
        used = (*self.outputs, *self.about.inputs)
        return replace(
            self.about,
            columns={n: h for n, h in self.about.columns.items() if n in used},
            time=self.sheet.headings[self.time],
            outputs=self.outputs,
            reference=self.reference,
            units={n: u for n, u in self.about.units.items() if n in used},
            from_zero=False,
            allow=ALLOWED,
            max_rows=None,
            # look computes KPIs of its own, and nobody says that the run was unsafe.
            kpis=None,
            end=End.TIME_UP,
        )

    def words(self) -> str:
        """Return what was taken for what."""
        heading = parts_of(self.sheet.headings[self.time])[0]
        unit = time_unit_of(self.sheet, self.time, None)
        parts = [f"time from {heading!r} in {unit}", f"outputs {_listed(self.outputs)}"]
        parts += [f"inputs {_listed(self.about.inputs)}"] if self.about.inputs else []
        parts += [f"references of {_listed(list(self.reference))}"] if self.reference else []
        return "; ".join([*parts, *self.said])


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)


def _timed(sheet: Sheet, time: int, time_format: str | None) -> tuple[Sheet, list[str]]:
    """Return the rows that have a time, and what reading them will mend."""
    said = []
    column = sheet.frame[time]
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
    t = instants(sheet, time, time_unit_of(sheet, time, None), time_format)
    if (np.diff(t) < 0).any():
        said.append("rows sorted by time")
    repeated = len(t) - len(np.unique(t))
    if repeated:
        said.append(f"of rows with the same time only the last one is kept ({repeated} left out)")
    ordered = np.unique(t)
    if len(long := gaps(ordered)):
        words = gap_words(ordered, int(long[0]), time_unit_of(sheet, time, None), len(long))
        said.append(f"{words}: bridged")
    return sheet, said


def _names(sheet: Sheet, about: TableColumns) -> dict[str, int]:
    """Return the number of each column by its name; columns without a heading have none."""
    names: dict[str, int] = {}
    for name, heading in about.columns.items():
        names[name] = sheet.column(heading, "")
    called = set(names.values())
    for i, heading in enumerate(sheet.headings):
        plain = parts_of(heading)[0]
        if plain and i not in called:
            names.setdefault(plain, i)
    for name in (*about.outputs, *about.inputs, *about.reference):
        if name not in names:
            names[name] = sheet.column(name, "")  # says which there are
    return names


def _references(sheet: Sheet, about: TableColumns, names: Mapping[str, int]) -> dict[str, Any]:
    """Return the reference of each output: a number, or the heading of a column."""
    found: dict[str, Any] = {}
    for name, i in names.items():
        if name.endswith(" ref") and name.removesuffix(" ref") in names:
            found[name.removesuffix(" ref")] = sheet.headings[i]
    for name, text in about.reference.items():
        try:
            found[name] = float(text)
        except ValueError:
            found[name] = sheet.headings[names[text] if text in names else sheet.column(text, "")]
    return found


def _check_references(about: TableColumns, outputs: Sequence[str]) -> None:
    """Refuse the reference of what is no output: it would neither be drawn nor measured."""
    for name in about.reference:
        if name not in outputs:
            there = "an input" if name in about.inputs else "not shown"
            raise RecordError(
                f"{name!r} has a reference but is {there}: the outputs are {_listed(outputs)}; "
                f"add it with --outputs, or leave --reference {name}=... out"
            )


def _outputs(
    sheet: Sheet, about: TableColumns, names: Mapping[str, int], used: set[int]
) -> tuple[tuple[str, ...], list[str]]:
    """Return the outputs, and what was left out."""
    import pandas as pd

    if about.outputs:
        return tuple(about.outputs), []
    there = {n: sheet.frame[i] for n, i in names.items() if i not in used}
    numeric = [n for n, values in there.items()
               if pd.api.types.is_numeric_dtype(values.dtype) and values.notna().any()]  # fmt: skip
    text = [n for n in there if n not in numeric]
    for name in text:
        if sheet.is_almost_numeric(names[name]):
            sheet.numbers(names[name])  # says which cell holds no number
    if not numeric:
        headings = _listed([parts_of(h)[0] for h in sheet.headings])
        raise RecordError(f"there is no column of numbers beside the time, only {headings}")
    said = [f"without numbers and left out: {_listed(text[:5])}"] if text else []
    if len(numeric) > _MOST:
        said.append(
            f"only the first {_MOST} of {len(numeric)} columns: choose others with --outputs"
        )
    return tuple(numeric[:_MOST]), said


def _bridged(sheet: Sheet, used: Sequence[str], names: Mapping[str, int]) -> list[str]:
    """Return which columns have empty cells before and after their last value."""
    filled, shorter = [], []
    for name in used:
        values = sheet.numbers(names[name])
        there = np.flatnonzero(np.isfinite(values))
        if len(there) and len(there) <= there[-1]:
            filled.append(name)
        if len(there) and there[-1] < len(values) - 1:
            shorter.append(name)
    said = [f"empty cells filled from their neighbors in {_listed(filled)}"] if filled else []
    return said + ([f"no values in the last rows of {_listed(shorter)}"] if shorter else [])
