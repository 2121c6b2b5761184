"""Make an experiment of a table: find its time, thin its rows, and name its columns."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from inspect import Signature, signature
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from prefcal_env import units
from prefcal_env.errors import RecordError, SettingsError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.wording import and_more

from .recorded import Limits, bridged, recorded
from .sheet import Sheet, Table, almost_a_number, parts_of, sheet_of

MAX_GAP = 10.0
"""Longest step of time that is no gap, in median steps."""
_CLOCK = re.compile(r"^(\d+):([0-5]\d)(?::([0-5]\d(?:[.,]\d*)?))?$")
"""Time of day, with seconds or without, or hours, minutes and seconds of a stopwatch."""
_HALF_DAY = 43200.0  # length of half a day in seconds
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
    return given or _unit_of_time(sheet.headings[column]) or "s"


def _unit_of_time(heading: str) -> str:
    """Return the unit of a heading of times such as "time [min]" or "time_min"; "" if it has none."""
    name, unit = parts_of(heading)
    before, _, end = name.rpartition("_")
    return unit or (end if before and units.seconds(end) else "")


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
    found, heading = sheet.numbers(column), _unit_of_time(sheet.headings[column]) or unit
    if not units.same(heading, unit):
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
        like = f"a time stamp like {time_format!r}"
        if time_format is None:
            like = "a number or a time stamp like 2026-11-23T09:30:00"
        raise RecordError(
            f"{sheet.place(row)}, column {sheet.name(column)!r}: expected {like}, "
            f"got {str(values.iloc[row])[:40]!r}{and_more(int(wrong.sum()))}; "
            "give time_format='%d/%m/%Y %H:%M:%S' or the like"
        )
    return found


def _seconds(unit: str) -> float:
    found = units.seconds(unit)
    if found is None:
        raise RecordError(f"the unit of time {unit!r} cannot be converted: use one of s, ms, us, min, h, d")
    return found


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


# --- Reduce the rows of a long table: to a grid, or to what a plot and KPIs need.


def period_of(resample: Any, unit: str) -> float:
    """Return a sampling period in `unit`, from a number or from text such as "0.1" or "100ms".

    Raises:
        SettingsError: If it is neither, or not above 0.
    """
    found = re.fullmatch(r"\s*(\d*\.?\d+(?:[eE][+-]?\d+)?)\s*([^\d\s]*)\s*", str(resample))
    value, given = (float(found[1]), found[2] or unit) if found else (0.0, unit)
    known = units.conversion(given, unit)
    value = 0.0 if known is None else known.to(value)
    if not 0 < value < np.inf:
        raise SettingsError(
            f"resample must be a period above 0 {unit}, such as 0.1 or '100ms', got {resample!r}"
        )
    return value


def grid(t: Float[np.ndarray, " K"], period: float, most: int = 10_000_000) -> Float[np.ndarray, " M"]:
    """Return the multiples of `period` from the first of the instants `t` to the last one.

    Raises:
        SettingsError: If there are more than `most`.
    """
    count = (t[-1] - t[0]) / period
    if count > most:
        raise SettingsError(f"resample={period:g} makes {count:.3g} rows: give a longer period")
    return np.asarray(t[0] + period * np.arange(int(np.floor(count * (1 + 1e-12) + 1e-9)) + 1))


def extreme_rows(columns: Sequence[Float[np.ndarray, " K"]], most: int) -> Int[np.ndarray, " M"]:
    """Return at most `most` rows, which hold the extreme values of each stretch of each column.

    NaN is ignored.
    """
    count = len(columns[0])
    if count <= most:
        return np.arange(count)
    stretches = max((most - 2) // (2 * len(columns)), 1)
    starts = np.linspace(0, count, stretches + 1).astype(int)
    width = int(np.diff(starts).max())
    rows = np.minimum(starts[:-1, None] + np.arange(width), starts[1:, None] - 1)
    kept = [np.array([0, count - 1])]
    for values in columns:
        parts = values[rows]
        for fill, pick in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            best = pick(np.where(np.isnan(parts), fill, parts), axis=1)
            kept.append(rows[np.arange(stretches), best])
    found = np.unique(np.concatenate(kept))
    # Of many columns not all extremes can be kept: what is left out lies all over the run.
    return np.asarray(found[np.linspace(0, len(found) - 1, min(most, len(found))).astype(int)])


# --- Make an experiment of a table: a DataFrame, a CSV or a Parquet file.

ALLOWED = ("unsorted", "duplicates", "missing", "gaps")
"""Flaws of a table that can be allowed; see `TableColumns`."""


@dataclass(frozen=True, kw_only=True)
class TableColumns:
    """What the columns of a table mean, for reading all tables of a study alike.

    A heading may carry its unit, as in "level [m]". Only the columns that are used must be clean.

    Args:
        columns: Maps our names to the table's headings where they differ, such as
            {"level": "TI-101.PV", "level ref": "TI-101.SP"}.
        time: Heading of the column with the time: numbers, durations or time stamps. None finds
            it by its usual names, or takes the index of a DataFrame; integers
            without a name are row numbers.
        outputs: Names of the outputs. If empty, all other columns that hold numbers.
        inputs: Names of the inputs.
        signals: Names of additional signals.
        reference: Maps names of outputs to a number or to the heading of a column. A column
            "NAME ref" is taken as the reference of the output NAME without being named.
        units: Maps names to units, for headings that carry none.
        limits: Maps names to (low, high) in their unit; None for no limit.
        bands: Maps names of outputs to their accepted distance from the reference.
        time_unit: Unit of the experiment's time; None takes the heading's, or else seconds.
        time_format: Format of time stamps as for `datetime.strptime`; None for ISO 8601.
        from_zero: Whether time counts from the first row, so that runs can be compared.
        allow: Flaws that are mended instead of refused: "unsorted" sorts the rows, "duplicates"
            keeps the last row of each instant, "missing" interpolates over (inputs: holds over)
            empty cells, "gaps" accepts steps longer than 10 median steps.
        resample: Period of a regular time axis, in the unit of time or as text such as "100ms".
            Values between rows are interpolated (inputs are held), not averaged. None keeps rows.
        max_rows: Largest number of rows: of longer tables, the rows with the extreme values of
            each stretch are kept, and KPIs are those of all rows. None keeps all.
        kpis: Function that returns the KPIs of an experiment by name; None for no KPIs.
        end: Why the run ended; None to conclude it from the table.

    Raises:
        SettingsError: If a word in `allow` is unknown or `max_rows` is too small.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    time: str | None = None
    outputs: Collection[str] = ()
    inputs: Collection[str] = ()
    signals: Collection[str] = ()
    reference: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, Limits] = field(default_factory=dict)
    bands: Mapping[str, float] = field(default_factory=dict)
    time_unit: str | None = None
    time_format: str | None = None
    from_zero: bool = True
    allow: Collection[str] = ()
    resample: float | str | None = None
    max_rows: int | None = 100_000
    kpis: Callable[[Experiment], Mapping[str, float]] | None = tracking_kpis
    end: End | None = None

    def __post_init__(self) -> None:
        for name in ("columns", "reference", "units", "limits", "bands"):
            if getattr(self, name) is None:  # as a caller passes on what they were not given
                object.__setattr__(self, name, {})
        for name in ("outputs", "inputs", "signals", "allow"):
            value = getattr(self, name)
            several = (value,) if isinstance(value, str) else () if value is None else tuple(value)
            object.__setattr__(self, name, several)
        unknown = sorted(set(self.allow) - set(ALLOWED))
        if unknown:
            raise SettingsError(f"allow must hold some of {ALLOWED}, got {unknown[0]!r}")
        if self.max_rows is not None and self.max_rows < 100:
            raise SettingsError(f"max_rows must be 100 or more, or None, got {self.max_rows}")

    def read(self, table: Table, theta: ArrayLike) -> Experiment:
        """Make an experiment of a table; see `from_frame`."""
        wanted = {*self.columns.values(), *self.outputs, *self.inputs, "time"}
        used = _Used.of(sheet_of(table, wanted), self).ordered()
        most = self.max_rows
        if most is None or self.resample is not None or len(used.t) <= most:
            return used.recorded(theta, self.kpis, self.end)
        kept = used.taken(extreme_rows(list(used.values.values()), most))
        if self.kpis is None:
            return kept.recorded(theta, None, self.end)
        # The extremes that are kept for plots are no fair sample of the errors and moves.
        every = used.recorded(theta, self.kpis, self.end)
        return kept.recorded(theta, None, every.end).with_kpis(every.kpis)


@dataclass(frozen=True, slots=True, eq=False)
class _Used:
    """The columns of a sheet that are used, as numbers, at times `t`; references are "NAME ref".

    `rows` are those of the sheet that are kept, and `places` its columns.
    """

    sheet: Sheet
    about: TableColumns
    time_unit: str
    t: Float[np.ndarray, " K"]
    rows: Int[np.ndarray, " K"]
    outputs: tuple[str, ...]
    places: Mapping[str, int]
    values: Mapping[str, Float[np.ndarray, " K"]]

    @classmethod
    def of(cls, sheet: Sheet, about: TableColumns) -> "_Used":
        """Find the columns and turn them into numbers."""
        if sheet.uneven:
            raise RecordError(sheet.uneven)
        if not len(sheet.frame):
            raise RecordError("a table needs a line of headings and rows of values, got headings only")
        time = time_column(sheet, about.columns.get("time", about.time))
        unit = time_unit_of(sheet, time, about.time_unit)
        t = instants(sheet, time, unit, about.time_format)
        outputs = tuple(about.outputs) or _other_columns(sheet, about, time)
        names = (*outputs, *about.inputs, *about.signals)
        places = {name: sheet.column(about.columns.get(name, name), name) for name in names}
        places |= _reference_places(sheet, about, outputs)
        if mixed := sheet.mixed([time, *places.values()]):
            raise RecordError(mixed)
        given = {_ref(n): sheet.unit(places[n], about.units.get(n)) for n in outputs}
        given |= {n: sheet.unit(places[n], about.units.get(n)) for n in names}
        values = {name: sheet.converted(place, given[name]) for name, place in places.items()}
        return cls(sheet, about, unit, t, np.arange(len(t)), outputs, places, values)

    def taken(self, kept: Int[np.ndarray, " M"] | Bool[np.ndarray, " K"]) -> "_Used":
        """Return these rows only."""
        values = {name: values[kept] for name, values in self.values.items()}
        return replace(self, t=self.t[kept], rows=self.rows[kept], values=values)

    def ordered(self) -> "_Used":
        """Return the rows in the order of time, from zero, without flaws that are not allowed."""
        allow, used = self.about.allow, self
        back = np.flatnonzero(np.diff(self.t) < 0)
        if len(back):
            self._allow(int(back[0]), len(back), "unsorted", "sort the rows")
            used = self.taken(np.argsort(self.t, kind="stable"))
        same = steps_back(used.t)
        if len(same):
            used._allow(int(same[0]), len(same), "duplicates", "keep the last row of each time")
            used = used.taken(np.append(np.diff(used.t) > 0, True))
        long = gaps(used.t)
        if len(long) and "gaps" not in allow:
            k = int(long[0])
            words = gap_words(used.t, k, self.time_unit, len(long))
            raise RecordError(f"{used.place(k + 1)}: {words}: fill it, or give allow=('gaps',) to bridge it")
        return replace(used, t=used.t - used.t[0]) if self.about.from_zero else used

    def place(self, k: int) -> str:
        """Return where row k is in the source, for messages."""
        return self.sheet.place(int(self.rows[k]))

    def _allow(self, k: int, count: int, word: str, what: str) -> None:
        """Refuse the step of time after row k, the first of `count`, unless `word` is allowed."""
        if word not in self.about.allow:
            wrong = step_back_words(self.t, k, self.time_unit, count)
            raise RecordError(
                f"{self.place(k + 1)}: {wrong}: if this is one run, give allow=({word!r},) to {what}"
            )

    def recorded(
        self, theta: ArrayLike, kpis: Callable[[Experiment], Mapping[str, float]] | None, end: End | None
    ) -> Experiment:
        """Return the experiment of these rows."""
        about, resample = self.about, self.about.resample
        curves = {name: self._curve(name) for name in self.values}
        t = self.t if resample is None else grid(self.t, period_of(resample, self.time_unit))
        numbers = {n: v for n, v in about.reference.items() if not isinstance(v, str)}
        columns = {n: curves[_ref(n)] for n in self.outputs if _ref(n) in curves}
        return recorded(
            theta,
            t,
            {n: curves[n] for n in self.outputs},
            {n: curves[n] for n in about.inputs},
            columns | numbers,
            self.units(),
            about.limits,
            bands=about.bands,
            signals={n: curves[n] for n in about.signals},
            kpis=kpis,
            end=end,
            time_unit=self.time_unit,
        )

    def _curve(self, name: str) -> Any:
        """Return a column as a curve for `recorded`; empty cells within it are refused."""
        values = self.values[name]
        finite = np.isfinite(values)
        if name not in self.about.signals and not finite.all():
            if not finite.any():
                called = self.sheet.name(self.places[name])
                raise RecordError(f"column {called!r} is empty: leave {name!r} out")
            last = len(finite) - int(np.argmax(finite[::-1]))  # rows up to the last value
            holes = np.flatnonzero(~finite[:last])
            if len(holes):
                values = self._bridged(name, holes, last)
        return values if self.about.resample is None else (self.t, values)

    def _bridged(self, name: str, holes: Int[np.ndarray, " M"], last: int) -> Float[np.ndarray, " K"]:
        """Return a column with empty cells filled; those before the first value get that value.

        Those after the `last` value stay empty: the run stopped there.
        """
        values = self.values[name]
        if "missing" not in self.about.allow:
            place, got = self.place(int(holes[0])), values[holes[0]]
            words = "nothing" if np.isnan(got) else f"{got:g}"
            lacks = self.sheet.lacking(self.places[name], place, words, len(holes))
            raise RecordError(f"{lacks}: fill it, or give allow=('missing',) to bridge them")
        filled = bridged(self.t, values, held=name not in self.outputs)
        filled[last:] = np.nan
        return np.asarray(filled)

    def units(self) -> dict[str, str]:
        """Return the unit of each output and input."""
        names = (*self.outputs, *self.about.inputs)
        known = [*names, *self.about.signals]
        unknown = [name for name in self.about.units if name not in known]
        if unknown:
            raise SettingsError(f"units names {unknown[0]!r}, which is none of {known}")
        return {n: self.sheet.unit(self.places[n], self.about.units.get(n)) for n in names}


def _ref(name: str) -> str:
    return f"{name} ref"


def _reference_places(sheet: Sheet, about: TableColumns, outputs: Collection[str]) -> dict[str, int]:
    """Return the columns of the references, named or called "NAME ref"."""
    unknown = [name for name in about.reference if name not in outputs]
    if unknown:
        raise SettingsError(f"reference names {unknown[0]!r}, which is none of {list(outputs)}")
    found = {}
    for name in outputs:
        heading = about.reference.get(name, about.columns.get(_ref(name)))
        if isinstance(heading, str):
            found[_ref(name)] = sheet.column(heading, _ref(name))
        elif heading is None and (place := sheet.find(_ref(name))) is not None:
            found[_ref(name)] = place
    return found


def _other_columns(sheet: Sheet, about: TableColumns, time: int) -> tuple[str, ...]:
    """Return the names of all columns of numbers that are not used otherwise."""
    import pandas as pd

    used = {*about.inputs, *about.signals}
    taken = {time, *(sheet.column(about.columns.get(n, n), n) for n in used)}
    taken |= {sheet.column(v, "") for v in about.reference.values() if isinstance(v, str)}
    renamed = {
        name: sheet.column(heading, name)
        for name, heading in about.columns.items()
        if name not in {*used, "time"}
    }
    called = {i: sheet.name(i) for i in range(len(sheet.headings))}
    there = {*renamed, *called.values()}
    found = [name for name, i in renamed.items() if i not in taken]
    for i, name in called.items():
        if i in {*taken, *renamed.values()}:
            continue
        if sheet.is_almost_numeric(i):
            sheet.numbers(i)  # says which cell holds no number
        if name not in about.columns and pd.api.types.is_numeric_dtype(sheet.frame[i].dtype):
            found.append(name)
    outputs = tuple(n for n in found if not (n.endswith(" ref") and n.removesuffix(" ref") in there))
    if not outputs:
        raise RecordError(
            f"no column but the time holds numbers only; name the outputs among "
            f"{', '.join(map(repr, called.values()))} as outputs=..."
        )
    return outputs


def from_frame(table: Table, theta: ArrayLike, **about: Any) -> Experiment:
    """Make an experiment of a table of logged data.

    The table is a pandas DataFrame, the path of a CSV or Parquet file, or the text of a CSV.
    Separators (comma, semicolon, tab, bar, spaces), decimal commas and encodings are found
    out. Columns that end early count as a run that stopped; see `prefcal_env.recorded`.

    Args:
        table: The table.
        theta: Controller parameters of the run, physical, shape (n,).
        about: The arguments of `TableColumns`, which reads several tables alike.

    Raises:
        RecordError: If the table cannot be read; the message names column, row and what to do.
        SettingsError: If an argument is not valid.
        ExperimentError: If names are used twice or do not exist.
    """
    return TableColumns(**about).read(table, theta)


_OWN = list(signature(from_frame).parameters.values())[:2]
from_frame.__signature__ = Signature(  # type: ignore[attr-defined]
    [*_OWN, *signature(TableColumns).parameters.values()], return_annotation=Experiment
)
