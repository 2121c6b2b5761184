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

from .historian import NO_HEADING, tidy
from .recorded import Limits, bridge, recorded
from .sheet import Sheet, Table, sheet_of
from .times import gap_words, gaps, instants, step_back_words, steps_back, time_column

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


def grid(t: Float[np.ndarray, " K"], period: float) -> Float[np.ndarray, " M"]:
    """Return the multiples of `period` from the first of the instants `t` to the last one.

    Raises:
        SettingsError: If there are more than 10 million.
    """
    count = (t[-1] - t[0]) / period
    if count > 1e7:
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
            it by its usual names, or takes the index of a DataFrame; integers without a name are row
            numbers, unless they are as large as seconds since 1970.
        outputs: Names of the outputs. If empty, all other columns that hold numbers.
        inputs: Names of the inputs.
        signals: Names of additional signals.
        reference: Maps names of outputs to a number or to the heading of a column. A column
            "NAME ref" is taken as the reference of the output NAME without being named.
        units: Maps names, and "time", to units, for headings that carry none.
        limits: Maps names to (low, high) in their unit; None for no limit.
        bands: Maps names of outputs to their accepted distance from the reference.
        time_unit: Unit of the experiment's time; None takes the heading's, or else seconds.
        time_format: Format of time stamps as for `datetime.strptime`; None for ISO 8601.
        from_zero: Whether time counts from the first row, so that runs can be compared.
        allow: Flaws that are mended instead of refused: "unsorted" sorts the rows, "duplicates"
            keeps the last row of each instant, "missing" interpolates over empty cells of outputs,
            holds their last value to the end, and bridges bad values such as "No Data", "gaps"
            accepts steps longer than 10 median steps. Inputs and references are held anyway.
        resample: Period of a regular time axis, in the unit of time or as text such as "100ms".
            Values between rows are interpolated (inputs are held), not averaged. None keeps rows.
        max_rows: Largest number of rows: of longer tables, the rows with the extreme values of
            each stretch are kept, and KPIs are those of all rows. None keeps all.
        kpis: Function that returns the KPIs of an experiment by name; None for no KPIs.
        end: Why the run ended; None to conclude it from the table.

    Raises:
        SettingsError: If a word in `allow` is unknown, a name comes twice, or `max_rows` is too small.
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
            if twice := [each for each in several if several.count(each) > 1]:
                raise SettingsError(f"{name} must name each once, got {twice[0]!r} twice")
        unknown = sorted(set(self.allow) - set(ALLOWED))
        if unknown:
            raise SettingsError(f"allow must hold some of {ALLOWED}, got {unknown[0]!r}")
        if self.max_rows is not None and self.max_rows < 100:
            raise SettingsError(f"max_rows must be 100 or more, or None, got {self.max_rows}")

    def used(self) -> set[str]:
        """Return the names and headings of columns that are asked for."""
        names = {*self.outputs, *self.inputs, *self.signals}
        headings = {v for v in self.reference.values() if isinstance(v, str)}
        return names | headings | {*self.columns.values()}

    def counted_in(self, time: str) -> str | None:
        """Return the unit of the numbers in the column `time`, if `units` says so."""
        return self.units.get("time", self.units.get(time))

    def read(self, table: Table, theta: ArrayLike) -> Experiment:
        """Make an experiment of a table; see `from_frame`."""
        return self.told(table, theta)[0]

    def told(self, table: Table, theta: ArrayLike) -> tuple[Experiment, str]:
        """Return the experiment of a table, and in words how its time was read."""
        wanted = {*self.columns.values(), *self.outputs, *self.inputs, "time"}
        used = _Used.of(sheet_of(table, wanted), self).ordered()
        most = self.max_rows
        if most is None or self.resample is not None or len(used.t) <= most:
            return used.to_experiment(theta, self.kpis, self.end), used.said
        kept = used.take(extreme_rows(list(used.values.values()), most))
        if self.kpis is None:
            return kept.to_experiment(theta, None, self.end), used.said
        # The extremes that are kept for plots are no fair sample of the errors and moves.
        every = used.to_experiment(theta, self.kpis, self.end)
        return kept.to_experiment(theta, None, every.end).with_kpis(every.kpis), used.said


@dataclass(frozen=True, slots=True, eq=False)
class _Used:
    """The columns of a sheet that are used, as numbers, at times `t`; references are "NAME ref".

    `rows` are those of the sheet that are kept, `places` its columns, and `time` is that of the time, which
    `said` says.
    """

    sheet: Sheet
    about: TableColumns
    time: str
    time_unit: str
    t: Float[np.ndarray, " K"]
    rows: Int[np.ndarray, " K"]
    outputs: tuple[str, ...]
    places: Mapping[str, int]
    values: Mapping[str, Float[np.ndarray, " K"]]
    said: str

    @classmethod
    def of(cls, sheet: Sheet, about: TableColumns) -> "_Used":
        """Find the columns and turn them into numbers."""
        if sheet.uneven:
            raise RecordError(sheet.uneven)
        if not len(sheet.frame):
            raise RecordError("a table needs a line of headings and rows of values, got headings only")
        time = time_column(sheet, about.columns.get("time", about.time))
        sheet, time = tidy(
            sheet, time, about.time_format, used=about.used(), repeated="duplicates" in about.allow
        )
        found = instants(sheet, time, about.time_unit, about.time_format, about.counted_in(sheet.name(time)))
        t, unit = found.t, found.unit
        outputs = tuple(about.outputs) or _other_columns(sheet, about, time)
        names = (*outputs, *about.inputs, *about.signals)
        places = {name: sheet.column(about.columns.get(name, name), name) for name in names}
        places |= _reference_places(sheet, about, outputs)
        if mixed := sheet.mixed([time, *places.values()]):
            raise RecordError(mixed)
        given = {_ref(n): sheet.unit(places[n], about.units.get(n)) for n in outputs}
        given |= {n: sheet.unit(places[n], about.units.get(n)) for n in names}
        values = {name: sheet.converted(place, given[name]) for name, place in places.items()}
        rows, said = np.arange(len(t)), found.words(sheet, time)
        return cls(sheet, about, sheet.name(time), unit, t, rows, outputs, places, values, said)

    def take(self, kept: Int[np.ndarray, " M"] | Bool[np.ndarray, " K"]) -> "_Used":
        """Return these rows only."""
        values = {name: values[kept] for name, values in self.values.items()}
        return replace(self, t=self.t[kept], rows=self.rows[kept], values=values)

    def ordered(self) -> "_Used":
        """Return the rows in the order of time, from zero, without flaws that are not allowed."""
        allow, used = self.about.allow, self
        back = np.flatnonzero(np.diff(self.t) < 0)
        if len(back):
            self._allow(int(back[0]), len(back), "unsorted", "sort the rows")
            used = self.take(np.argsort(self.t, kind="stable"))
        same = steps_back(used.t)
        if len(same):
            used._allow(int(same[0]), len(same), "duplicates", "keep the last row of each time")
            used = used._last_of_each_time()
        if self.sheet.own_times or "missing" in allow:
            used = used._from_the_first_output()
        long = gaps(used.t)
        if len(long) and "gaps" not in allow:
            k = int(long[0])
            words = gap_words(used.t, k, self.time_unit, len(long))
            raise RecordError(f"{used.place(k + 1)}: {words}: fill it, or give allow=('gaps',) to bridge it")
        return replace(used, t=used.t - used.t[0]) if self.about.from_zero else used

    def _from_the_first_output(self) -> "_Used":
        """Return the rows from the first value of an output on, where what was set before still holds."""
        begin = min(int(np.argmax(np.isfinite(self.values[name]))) for name in self.outputs)
        values = dict(self.values)
        for name in values.keys() - {*self.outputs, *self.about.signals} if begin else ():
            before = bridge(self.t[: begin + 1], values[name][: begin + 1], held=True)[-1]
            values[name] = np.append(values[name][:begin], [before, *values[name][begin + 1 :]])
        return replace(self, values=values).take(np.arange(begin, len(self.t)))

    def _last_of_each_time(self) -> "_Used":
        """Return one row for each time, with the last value that each column has then."""
        last = np.flatnonzero(np.append(np.diff(self.t) > 0, True))
        first = np.append(0, last[:-1] + 1)
        kept = self.take(last)
        values = {}
        for name, each in self.values.items():
            there = np.maximum.accumulate(np.where(np.isnan(each), -1, np.arange(len(each))))[last]
            values[name] = np.where(there < first, np.nan, each[there])
        return replace(kept, values=values)

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

    def to_experiment(
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
        """Return a column as a curve for `recorded`, without the gaps that may be bridged."""
        values = self.values[name]
        if name not in self.about.signals and not np.isfinite(values).all():
            values = self._bridged(name, values)
        return values if self.about.resample is None else (self.t, values)

    def _bridged(self, name: str, values: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
        """Return a column with empty cells filled.

        Loggers write what changes: an input or a reference keeps its value, an output goes straight
        to its next one and keeps its last one. After the row at which the run stopped, outputs stay
        empty.
        """
        finite = np.isfinite(values)
        if not finite.any():
            called = self.sheet.name(self.places[name])
            raise RecordError(f"column {called!r} is empty: leave {name!r} out")
        held = name not in self.outputs
        first, stop = int(np.argmax(finite)), self._stop()
        written = self.sheet.bad.get(self.places[name], {})
        bad = ~finite & np.array([row in written for row in self.rows.tolist()])
        flaws = bad.copy()
        if held:  # what holds before the first value is not known, and infinite is not empty
            flaws |= ~finite & ((np.arange(len(values)) < first) | np.isinf(values))
        elif not self.sheet.own_times:
            flaws |= ~finite
        flaws[stop:] &= bad[stop:]
        if flaws.any() and "missing" not in self.about.allow:
            k = int(np.argmax(flaws))
            got = self.sheet.got(self.places[name], int(self.rows[k]), values[k])
            lacks = self.sheet.lacking(self.places[name], self.place(k), got, int(flaws.sum()))
            raise RecordError(f"{lacks}: fill it, or give allow=('missing',) to bridge them")
        # Half a pump does not run: what is on or off keeps its value, too.
        switched = set(values[finite]) == {0.0, 1.0}
        filled = bridge(self.t, values, held=held or switched)
        if not held:
            filled[stop:] = np.nan
        elif name not in self.about.inputs:
            filled[:first] = np.nan  # a reference that is not known yet: nothing is measured
        return np.asarray(filled)

    def _stop(self) -> int:
        """Return the number of rows before the run stopped: later ones have no output, or diverged."""
        ends, diverged = [0], [len(self.t)]
        for name in self.outputs:
            finite = np.isfinite(self.values[name])
            last = len(finite) - int(np.argmax(finite[::-1])) if finite.any() else 0
            ends.append(last)
            if np.isinf(self.values[name][last:]).any():
                diverged.append(last)
        return min(max(ends), *diverged)

    def units(self) -> dict[str, str]:
        """Return the unit of each output and input."""
        names = (*self.outputs, *self.about.inputs)
        known = [*names, *self.about.signals]
        times = ("time", self.time)
        unknown = [name for name in self.about.units if name not in known and name not in times]
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
    taken = {time, *sheet.aside, *(sheet.column(about.columns.get(n, n), n) for n in used)}
    for i, why in sheet.aside.items():
        if why == NO_HEADING and sheet.frame[i].dtype.kind in "iuf" and sheet.frame[i].notna().any():
            raise RecordError(f"column {i + 1} has numbers but no heading: name it, or remove it")
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

    The table is a pandas DataFrame, the path of a CSV, Parquet or Excel file, or the text of a CSV.
    Separators (comma, semicolon, tab, bar, spaces), decimal commas and encodings are found
    out, and so are tables with one row for each tag, quality columns, and time stamps in seconds,
    milliseconds and finer. If all outputs end early, the run stopped; see `prefcal_env.recorded`.

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
