"""Find the time of a table, turn it into numbers, and find steps that lead back or skip rows."""

import re
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import RecordError
from prefcal_env.wording import and_more

from .sheet import Sheet, almost_a_number
from .units import SECONDS, parts_of

MAX_GAP = 10.0
"""Longest step of time that is no gap, in median steps."""
_CLOCK = re.compile(r"^(\d+):([0-5]\d)(?::([0-5]\d(?:[.,]\d*)?))?$")
"""Time of day, with seconds or without, or hours, minutes and seconds of a stopwatch."""
_HALF_DAY = 43200.0
"""Length of half a day in seconds."""
_NAMES = ("time", "t", "timestamp", "datetime", "date", "date time", "time stamp", "index")
"""Usual names of the column with the time, in lower case."""


def time_column(sheet: Sheet, given: str | None) -> int:
    """Return the number of the column `given`, or else of the one with a usual name of the time.

    Raises:
        RecordError: If there is none, or there are several.
    """
    if given is not None:
        return sheet.column(given, "")
    found = usual_time_columns(sheet)
    if len(found) == 1:
        return found[0]
    there = ", ".join(repr(parts_of(h)[0]) for h in sheet.headings[:12])
    what = "several columns may be the time" if found else "no column is called time"
    raise RecordError(f"{what}: give the right one as time=...; there are {there}")


def usual_time_columns(sheet: Sheet) -> list[int]:
    """Return the numbers of the columns called time, or else of all with usual names for it."""
    called = [sheet.name(i).lower() for i in range(len(sheet.headings))]
    exact = [i for i, name in enumerate(called) if name == "time"]
    return exact or [i for i, name in enumerate(called) if name in _NAMES]


def time_unit_of(sheet: Sheet, column: int, given: str | None) -> str:
    """Return the unit of the experiment's time: `given`, or the heading's, or seconds."""
    return given or parts_of(sheet.headings[column])[1] or "s"


def instants(sheet: Sheet, column: int, unit: str, time_format: str | None) -> Float[np.ndarray, " K"]:
    """Return the time of each row in `unit`, shape (K,).

    Time stamps count from the earliest one; those with time zones are converted to UTC.

    Args:
        sheet: Table.
        column: Number of the column with the time.
        unit: Unit of time.
        time_format: Format of time stamps as for `datetime.strptime`; None for ISO 8601.

    Raises:
        RecordError: If a cell is empty or no time, or units of time cannot be converted.
    """
    import pandas as pd

    values = sheet.frame[column]
    _check_filled(sheet, column, np.asarray(values.isna()))
    if pd.api.types.is_timedelta64_dtype(values.dtype):
        return np.asarray(values.dt.total_seconds().to_numpy() / _seconds(unit))
    if time_format is None and (clock := _clock(values)) is not None:
        return clock / _seconds(unit)
    stamps = _stamps(sheet, column, values, time_format)
    if stamps is not None:
        elapsed = (stamps - stamps.min()).dt.total_seconds().to_numpy(dtype=float)
        return np.asarray(elapsed / _seconds(unit))
    found, heading = sheet.numbers(column), parts_of(sheet.headings[column])[1] or unit
    if heading != unit:
        found = found * (_seconds(heading) / _seconds(unit))
    _check_filled(sheet, column, ~np.isfinite(found))
    return found


def _clock(values: Any) -> Float[np.ndarray, " K"] | None:
    """Return times such as 09:30:00 in seconds; None if not all values are such times.

    A step back by more than half a day passes midnight.
    """
    import pandas as pd

    if not pd.api.types.is_string_dtype(values.dtype):
        return None
    parts = values.astype(str).str.strip().str.extract(_CLOCK)
    if parts[0].isna().any():
        return None
    parts[2] = parts[2].fillna("0")
    t = sum(
        scale * parts[i].str.replace(",", ".").astype(float).to_numpy()
        for i, scale in enumerate((3600.0, 60.0, 1.0))
    )
    days = np.cumsum(np.append(0, np.diff(t) < -_HALF_DAY))
    return np.asarray(t + 2 * _HALF_DAY * days)


def _check_filled(sheet: Sheet, column: int, empty: np.ndarray) -> None:
    """Refuse rows without a time."""
    if empty.any():
        row = int(np.argmax(empty))
        raise RecordError(
            f"{sheet.place(row)}, column {sheet.name(column)!r}: expected a time, "
            f"got nothing{and_more(int(empty.sum()))}: fill it, or remove the row"
        )


def _stamps(sheet: Sheet, column: int, values: Any, time_format: str | None) -> Any | None:
    """Return time stamps as a pandas Series in UTC; None if the column holds numbers."""
    import pandas as pd

    if pd.api.types.is_datetime64_any_dtype(values.dtype):
        return values
    if pd.api.types.is_numeric_dtype(values.dtype):
        return None
    text = values.astype(str).str.strip()
    if time_format is None and almost_a_number(text.iloc[0]):
        return None
    german = r"\d{1,2}\.\d{1,2}\.\d{4}.*"  # dots come with the day first
    dotted = time_format is None and re.fullmatch(german, text.iloc[0]) is not None
    if dotted:
        found = pd.to_datetime(text, format="mixed", dayfirst=True, errors="coerce", utc=True)
    else:
        text = text.str.replace(r"(:\d\d),(\d+)", r"\1.\2", regex=True)
        found = pd.to_datetime(text, format=time_format or "ISO8601", errors="coerce", utc=True)
    wrong = np.asarray(found.isna())
    if wrong.any():
        other = wrong & ~np.asarray(text.str.match(_CLOCK), dtype=bool)
        wrong = other if other.any() else wrong  # the odd one among times of day
        row = int(np.argmax(wrong))
        raise RecordError(
            f"{sheet.place(row)}, column {sheet.name(column)!r}: expected "
            f"{_expected(time_format)}, got {str(values.iloc[row])[:40]!r}"
            f"{and_more(int(wrong.sum()))}; give time_format='%d/%m/%Y %H:%M:%S' or the like"
        )
    return found


def _expected(time_format: str | None) -> str:
    if time_format is not None:
        return f"a time stamp like {time_format!r}"
    return "a number or a time stamp like 2026-11-23T09:30:00"


def _seconds(unit: str) -> float:
    if unit not in SECONDS:
        raise RecordError(f"the unit of time {unit!r} cannot be converted: use one of s, ms, us, min, h, d")
    return SECONDS[unit]


def steps_back(t: Float[np.ndarray, " K"]) -> Int[np.ndarray, " M"]:
    """Return each row, from 0, whose successor is not later."""
    with np.errstate(over="ignore"):
        return np.flatnonzero(np.diff(t) <= 0)


def gaps(t: Float[np.ndarray, " K"], longest: float = MAX_GAP) -> Int[np.ndarray, " M"]:
    """Return each row, from 0, that a gap follows: a step above `longest` median steps."""
    with np.errstate(over="ignore"):
        return np.flatnonzero(np.diff(t) > longest * _usual(t))


def step_back_words(t: Float[np.ndarray, " K"], k: int, unit: str, count: int) -> str:
    """Return what is wrong with the step of time after row k, the first of `count`."""
    return f"time must increase, got {t[k + 1]:g} {unit} after {t[k]:g} {unit}{and_more(count)}"


def gap_words(t: Float[np.ndarray, " K"], k: int, unit: str, count: int) -> str:
    """Return which gap follows row k, the first of `count`."""
    return (
        f"a gap of {t[k + 1] - t[k]:g} {unit} after {t[k]:g} {unit}, where {_usual(t):g} {unit} "
        f"is usual{and_more(count)}"
    )


def _usual(t: Float[np.ndarray, " K"]) -> float:
    """Return the median step; 0 without steps."""
    return float(np.median(np.diff(t))) if len(t) > 1 else 0.0
