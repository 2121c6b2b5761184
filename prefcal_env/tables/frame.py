"""Make an experiment of a table: a DataFrame, a CSV or a Parquet file."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from inspect import Signature, signature
from typing import Any, ParamSpec, Protocol

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from prefcal_env.errors import RecordError, SettingsError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.experiments.recorded import Limits, recorded
from prefcal_env.wording import and_more

from .sheet import Sheet, Table, sheet_of
from .steps import gap_words, gaps, step_back_words, steps_back
from .thinning import extreme_rows, grid, period_of
from .timing import instants, time_column, time_unit_of
from .units import parts_of

ALLOWED = ("unsorted", "duplicates", "missing", "gaps")
"""Flaws of a table that can be allowed; see `TableColumns`."""
_P = ParamSpec("_P")


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
        kept = used.thinned()
        if kept is used or self.kpis is None:
            return kept.recorded(theta, self.kpis, self.end)
        # The extremes that are kept for plots are no fair sample of the errors and moves.
        every = used.recorded(theta, self.kpis, self.end)
        return kept.recorded(theta, None, every.end).with_kpis(every.kpis)


@dataclass(frozen=True, slots=True, eq=False)
class _Used:
    """The columns of a sheet that are used, as numbers.

    Args:
        sheet: Table.
        about: What its columns mean.
        time_unit: Unit of `t`.
        t: Time of each row, shape (K,).
        rows: Row of the sheet of each row kept, shape (K,).
        outputs: Names of the outputs.
        places: Column of the sheet by name; references are called "NAME ref".
        values: Values by name, each of shape (K,).
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
        if not len(sheet.frame):
            raise RecordError("a table needs rows of values, got none")
        time = time_column(sheet, about.columns.get("time", about.time))
        unit = time_unit_of(sheet, time, about.time_unit)
        t, _ = instants(sheet, time, unit, about.time_format)
        outputs = tuple(about.outputs) or _other_columns(sheet, about, time)
        names = (*outputs, *about.inputs, *about.signals)
        places = {name: sheet.column(about.columns.get(name, name), name) for name in names}
        places |= _reference_places(sheet, about, outputs)
        values = {name: sheet.numbers(place) for name, place in places.items()}
        return cls(sheet, about, unit, t, np.arange(len(t)), outputs, places, values)

    def taken(self, kept: Int[np.ndarray, " M"] | Bool[np.ndarray, " K"]) -> "_Used":
        """Return these rows only."""
        return _Used(
            self.sheet, self.about, self.time_unit, self.t[kept], self.rows[kept], self.outputs,
            self.places, {name: values[kept] for name, values in self.values.items()},
        )  # fmt: skip

    def ordered(self) -> "_Used":
        """Return the rows in the order of time, from zero, without flaws that are not allowed."""
        allow, used = self.about.allow, self
        back = np.flatnonzero(np.diff(self.t) < 0)
        if len(back) and "unsorted" not in allow:
            raise RecordError(self._step(int(back[0]), len(back), "unsorted", "sort the rows"))
        if len(back):
            used = self.taken(np.argsort(self.t, kind="stable"))
        same = steps_back(used.t)
        if len(same) and "duplicates" not in allow:
            raise RecordError(
                used._step(int(same[0]), len(same), "duplicates", "keep the last row of each time")
            )
        if len(same):
            used = used.taken(np.append(np.diff(used.t) > 0, True))
        long = gaps(used.t)
        if len(long) and "gaps" not in allow:
            k = int(long[0])
            raise RecordError(
                f"{used.place(k + 1)}: {gap_words(used.t, k, self.time_unit, len(long))}: fill it, "
                "or give allow=('gaps',) to bridge it"
            )
        return used.from_zero() if self.about.from_zero and len(used.t) else used

    def from_zero(self) -> "_Used":
        """Return the same with time that counts from the first row."""
        return replace(self, t=self.t - self.t[0])

    def place(self, k: int) -> str:
        """Return where row k is in the source, for messages."""
        return self.sheet.place(int(self.rows[k]))

    def _step(self, k: int, count: int, word: str, what: str) -> str:
        """Return what is wrong with the step of time after row k."""
        wrong = step_back_words(self.t, k, self.time_unit, count)
        return f"{self.place(k + 1)}: {wrong}: if this is one run, give allow=({word!r},) to {what}"

    def thinned(self) -> "_Used":
        """Return at most `max_rows` rows, unless the table is resampled anyway."""
        most = self.about.max_rows
        if most is None or self.about.resample is not None or len(self.t) <= most:
            return self
        return self.taken(extreme_rows(list(self.values.values()), most))

    def recorded(
        self,
        theta: ArrayLike,
        kpis: Callable[[Experiment], Mapping[str, float]] | None,
        end: End | None,
    ) -> Experiment:
        """Return the experiment of these rows."""
        about, made = self.about, self.curves()
        return recorded(
            theta, self.axis(), {n: made[n] for n in self.outputs},
            {n: made[n] for n in about.inputs}, self.reference_curves(),
            self.units(), about.limits, bands=about.bands,
            signals={n: made[n] for n in about.signals}, kpis=kpis, end=end,
            time_unit=self.time_unit,
        )  # fmt: skip

    def axis(self) -> Float[np.ndarray, " M"]:
        """Return the instants of the experiment."""
        if self.about.resample is None:
            return self.t
        return grid(self.t, period_of(self.about.resample, self.time_unit))

    def curves(self) -> dict[str, Any]:
        """Return each column as a curve for `recorded`; empty cells within it are refused."""
        return {name: self._curve(name) for name in self.values}

    def _curve(self, name: str) -> Any:
        values = self.values[name]
        resampled = self.about.resample is not None
        if name in self.about.signals:
            return (self.t, values) if resampled else values
        finite = np.isfinite(values)
        if not finite.any() and finite.size:
            called = parts_of(self.sheet.headings[self.places[name]])[0]
            raise RecordError(f"column {called!r} is empty: leave {name!r} out")
        last = len(finite) - int(np.argmax(finite[::-1]))  # rows up to the last value
        holes = np.flatnonzero(~finite[:last])
        if len(holes) and "missing" not in self.about.allow:
            called = parts_of(self.sheet.headings[self.places[name]])[0]
            got = "nothing" if np.isnan(values[holes[0]]) else f"{values[holes[0]]:g}"
            raise RecordError(
                f"{self.place(int(holes[0]))}, column {called!r}: expected a number, got {got}"
                f"{and_more(len(holes))}: fill it, or give allow=('missing',) to bridge them"
            )
        if len(holes):
            return self._bridged(name, values, finite)
        return (self.t, values) if resampled else values

    def _bridged(
        self, name: str, values: Float[np.ndarray, " K"], finite: Bool[np.ndarray, " K"]
    ) -> Any:
        """Return a column with empty cells filled; those before the first value get that value.

        Those after the last value stay empty: the run stopped there.
        """
        if name in self.outputs:
            filled = np.interp(self.t, self.t[finite], values[finite])
        else:
            latest = np.maximum.accumulate(np.where(finite, np.arange(len(values)), -1))
            filled = values[np.where(latest < 0, int(np.argmax(finite)), latest)]
        filled[len(finite) - int(np.argmax(finite[::-1])) :] = np.nan
        return filled if self.about.resample is None else (self.t, filled)

    def reference_curves(self) -> dict[str, Any]:
        """Return the reference of each output that has one."""
        found: dict[str, Any] = {}
        for name in self.outputs:
            if _ref(name) in self.values:
                found[name] = self._curve(_ref(name))
        for name, value in self.about.reference.items():
            if not isinstance(value, str):
                found[name] = value
        return found

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


def _reference_places(
    sheet: Sheet, about: TableColumns, outputs: Collection[str]
) -> dict[str, int]:
    """Return the columns of the references, named or called "NAME ref"."""
    unknown = [name for name in about.reference if name not in outputs]
    if unknown:
        raise SettingsError(f"reference names {unknown[0]!r}, which is none of {list(outputs)}")
    found = {}
    for name in outputs:
        given = about.reference.get(name)
        place = sheet.find(_ref(name)) if given is None else None
        if given is None and _ref(name) in about.columns:
            place = sheet.column(about.columns[_ref(name)], _ref(name))
        if isinstance(given, str):
            place = sheet.column(given, _ref(name))
        if place is not None:
            found[_ref(name)] = place
    return found


def _other_columns(sheet: Sheet, about: TableColumns, time: int) -> tuple[str, ...]:
    """Return the names of all columns of numbers that are not used otherwise."""
    import pandas as pd

    used = {*about.inputs, *about.signals}
    taken = {time, *(sheet.column(about.columns.get(n, n), n) for n in used)}
    taken |= {sheet.column(v, "") for v in about.reference.values() if isinstance(v, str)}
    renamed = {n: sheet.column(h, n) for n, h in about.columns.items() if n not in used}
    renamed.pop("time", None)
    names = {i: parts_of(h)[0] for i, h in enumerate(sheet.headings)}
    places = [(name, i) for name, i in renamed.items() if i not in taken]
    places += [
        (name, i)
        for i, name in names.items()
        if i not in {*taken, *renamed.values()}
        and name not in about.columns
        and pd.api.types.is_numeric_dtype(sheet.frame[i].dtype)
    ]
    for i in {*names} - {*taken, *renamed.values()}:
        if sheet.is_almost_numeric(i):
            sheet.numbers(i)  # says which cell holds no number
    there = {*renamed, *names.values()}
    found = tuple(
        name
        for name, _ in places
        if not (name.endswith(" ref") and name.removesuffix(" ref") in there)
    )
    if not found:
        raise RecordError(
            f"no column but the time holds numbers only; name the outputs among "
            f"{', '.join(map(repr, names.values()))} as outputs=..."
        )
    return found


class _FromFrame(Protocol[_P]):
    """Type of `from_frame`: unlike one with `Concatenate`, its first arguments may be named."""

    def __call__(
        self, table: Table, theta: ArrayLike, *args: _P.args, **about: _P.kwargs
    ) -> Experiment: ...


def _easy(columns: Callable[_P, TableColumns]) -> _FromFrame[_P]:
    """Return a function that reads one table, with the arguments of `columns`."""

    def from_frame(
        table: Table, theta: ArrayLike, *args: _P.args, **about: _P.kwargs
    ) -> Experiment:
        """Make an experiment of a table of logged data.

        The table is a pandas DataFrame, the path of a CSV or Parquet file, or the text of a CSV.
        Separators (comma, semicolon, tab, bar, spaces), decimal commas and encodings are found
        out. Columns that end early count as a run that stopped; see `prefcal_env.recorded`.

        Args:
            table: The table.
            theta: Controller parameters of the run, physical, shape (n,).
            args: None; all other arguments are named.
            about: The arguments of `TableColumns`, which reads several tables alike.

        Raises:
            RecordError: If the table cannot be read; the message names column, row and what to do.
            SettingsError: If an argument is not valid.
            ExperimentError: If names are used twice or do not exist.
        """
        return columns(*args, **about).read(table, theta)

    first = list(signature(from_frame).parameters.values())[:2]
    others = signature(columns).parameters.values()
    made: Any = from_frame
    made.__signature__ = Signature([*first, *others], return_annotation=Experiment)
    made.__qualname__ = "from_frame"
    return from_frame


from_frame = _easy(TableColumns)
