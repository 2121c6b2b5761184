"""A plant that only a person can run: they receive θ and return a record."""

import csv
import io
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env import units
from prefcal_env.errors import RecordError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment, compute
from prefcal_env.tables import historian, times
from prefcal_env.tables.recorded import bridge
from prefcal_env.tables.sheet import Sheet, Table, parts_of, sheet_of
from prefcal_env.wording import and_more, labeled

from .source import Change, KPIsOf, Run, Source, with_own
from .source import Table as Given

TIME = "time"
_FILES = (".csv", ".txt", ".parquet", ".xlsx", ".xls")
_MOST_LISTED = 5  # largest number of problems in a message; people fix some of them and try again
_WIDEST = 1e30  # largest plausible value in any unit; beyond it plots and sums overflow


@dataclass(frozen=True)
class Rig(Source):
    """The `run` of a scenario whose experiments are done by a person.

    Records are CSV files with a column `time` and one column for each state, each output that is
    no state, and each input of `channels`. Columns in other units are converted to the channels'.
    If the reference of an output changes, the record may have a column "NAME ref" as well. Front
    ends show the person θ, the columns and `instructions`.

    Args:
        channels: Names, units, limits and targets of states, inputs and outputs.
        y_ref: Reference of each output, in its unit, for records without a column for it.
        kpis: Function that returns the key performance indicators of a record by name.
        ranges: Maps a channel's name to the range of its sensor, in its unit. A value outside is
            refused: most likely it is in another unit.
        instructions: Instructions that tell the person how to run an experiment.
        max_gap: Longest step in time that is not a gap, in median steps.
        max_rows: Largest number of rows of a record.
        headings: Maps "time" and names of channels to the headings of the record's columns where
            they differ, such as {"temperature": "TI-101.PV"}.
        time_format: Format of time stamps, such as "%d/%m/%Y %H:%M:%S"; None for ISO 8601, or
            days and months with points. They count from the earliest one.

    Raises:
        SettingsError: If references or ranges do not fit the channels, or a bound is not valid.
    """

    channels: Channels = field()
    y_ref: tuple[float, ...] = field()
    kpis: Callable[[Experiment], Mapping[str, float]] | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    instructions: str = ""
    max_gap: float = times.MAX_GAP
    max_rows: int = 200_000
    headings: Mapping[str, str] = field(default_factory=dict)
    time_format: str | None = None

    columns: tuple[str, ...] = field(init=False, repr=False, compare=False)
    """Headings of a record, with units."""

    asks = "record"
    signals = ()
    """Additional signals of the records: none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "computes_kpis", self.kpis is not None)
        object.__setattr__(self, "columns", tuple(labeled(*each) for each in self._units.items()))
        object.__setattr__(self, "y_ref", tuple(map(float, self.y_ref)))
        if len(self.y_ref) != len(self.channels.y) or not np.all(np.isfinite(self.y_ref)):
            raise SettingsError(
                f"y_ref must hold a finite reference for each of {len(self.channels.y)} outputs, "
                f"got {self.y_ref}"
            )
        signals = [c.name for c in self.kept_channels]
        names = (TIME, *signals, *(f"{c.name} ref" for c in self.channels.y))
        unknown = [name for name in self.headings if name not in names]
        if unknown:
            raise SettingsError(f"headings must name some of {names}, got {unknown[0]!r}")
        called = [self.headings.get(name, name) for name in names]
        if len(set(called)) != len(called):
            raise SettingsError(f"the names of the columns must differ, got {tuple(called)}")
        for name, (low, high) in self.ranges.items():
            if name not in names or not low < high:
                raise SettingsError(
                    f"ranges must give low < high of one of {names}, got {name!r}: {low, high}"
                )
        if not self.max_gap > 1 or self.max_rows < 2:
            raise SettingsError(
                f"max_gap must be above 1 and max_rows 2 or more, got {self.max_gap} and {self.max_rows}"
            )

    def begin(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Run:
        """Return a run of θ, physical, shape (n,), that waits for its record."""
        return _RigRun(self, theta)

    def measured(self, kpis_of: KPIsOf) -> "Rig":
        """Return the same rig, whose records have more KPIs than their own."""
        return replace(self, kpis=with_own(self.kpis, kpis_of(self.channels)))

    def _called(self, name: str) -> str:
        """Return the heading of a column without its unit."""
        return self.headings.get(name, name)

    @property
    def _units(self) -> dict[str, str]:
        """Unit of each column that a record must have, by its heading, time first."""
        signals = {self._called(c.name): c.unit for c in self.kept_channels}
        return {self._called(TIME): self.channels.time_unit, **signals}

    @property
    def _optional(self) -> dict[str, str]:
        """Unit of each column that a record may have, by its heading: the references."""
        return {self._called(f"{c.name} ref"): c.unit for c in self.channels.y}

    @property
    def kept_channels(self) -> tuple[Channel, ...]:
        """Channels with a column, in the order of the columns."""
        return (*self.channels.x, *self._measured, *self.channels.u)

    @property
    def _measured(self) -> tuple[Channel, ...]:
        """Outputs that are no state."""
        states = {(c.name, units.plain(c.unit)) for c in self.channels.x}
        return tuple(c for c in self.channels.y if (c.name, units.plain(c.unit)) not in states)

    def template(self) -> str:
        """Return the first line of a record, quoted where a name needs it."""
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(self.columns)
        return line.getvalue()

    def read(self, source: Any, theta: Float[np.ndarray, " n"], *, unsafe: bool = False) -> Experiment:
        """Return the experiment of a physical θ, shape (n,), from its record.

        Args:
            source: Text of a CSV, path of a CSV, Parquet or Excel file, its content as bytes, or a
                pandas DataFrame. Lines in messages count the headings as line 1, rows of a DataFrame or
                a Parquet file count from 0.
            theta: Controller parameters of the run.
            unsafe: Whether the run was stopped because it became unsafe.

        Raises:
            RecordError: If the record is not valid; the message lists all problems.
        """
        end = End.UNSAFE if unsafe else End.TIME_UP
        made = self._of(self._values(source), theta, end)
        return made if self.kpis is None else replace(made, kpis=_compute(self.kpis, made))

    def example(self, theta: Float[np.ndarray, " n"]) -> Experiment:
        """Return the experiment of a physical θ, shape (n,), from a made-up record.

        Raises:
            ScenarioError: If the rig refuses it.
        """
        values = []
        for channel in self.kept_channels:
            limits = self.ranges.get(channel.name, (channel.low, channel.high))
            finite = [float(v) for v in limits if np.isfinite(v)]
            values.append(sum(finite) / len(finite) if finite else 1.0)
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([t, *values] for t in self._example_times())
        try:
            return self.read(self.template() + text.getvalue(), theta)
        except RecordError as error:
            raise ScenarioError(f"a made-up record is refused: {error}") from error

    def _example_times(self) -> list[str]:
        """Return 60 times of a record, as stamps if there is a format of them."""
        if self.time_format is None:
            return [f"{t}" for t in range(60)]
        start = datetime(2026, 1, 1, tzinfo=UTC)
        stamps: list[str] = []
        for step in (1.0, 60.0, 3600.0, 86400.0):  # the first one that the format can tell
            stamps = [(start + timedelta(seconds=step * k)).strftime(self.time_format) for k in range(60)]
            if len(set(stamps)) == len(stamps):
                break
        return stamps

    def _values(self, source: Table) -> Float[np.ndarray, "K n"]:
        """Return the values of a record, shape (K, n); NaN for optional columns that are absent.

        Separators are commas, semicolons, tabs, bars or spaces; without commas, numbers may have a
        decimal comma. Lines that begin with # and unknown columns are ignored. Time stamps count
        from the earliest one.
        """
        if isinstance(source, str):
            if not source.strip():
                raise RecordError(f"the record is empty: expected {', '.join(self.columns)}")
            # Text without a line end is a path only if it ends like one.
            source = source if Path(source).suffix.lower() in _FILES else source + "\n"
        known = {**self._units, **self._optional}
        wanted = {*known, *(labeled(n, u) for n, u in known.items())}
        stamps = () if self.time_format is None else (self._called(TIME),)
        sheet = self._tidy(sheet_of(source, wanted, stamps), known)
        places, count = self._places(sheet, known), len(sheet.frame)
        if count < 2:
            raise RecordError(f"a record needs 2 rows of values or more, got {count}")
        if count > self.max_rows:
            raise RecordError(f"a record may have {self.max_rows} rows, got {count}")
        values = np.full((count, len(known)), np.nan)
        problems = [*filter(None, [sheet.uneven, sheet.mixed(places.values())])]
        for i, name in enumerate(known):
            if name in places:
                problems += self._fill(sheet, places[name], name, values, i, known[name])
        problems += [*self._steps(values[:, 0], sheet), *self._outside(values, known, sheet)]
        _refuse(problems)
        return values

    def _tidy(self, sheet: Sheet, known: Collection[str]) -> Sheet:
        """Return the sheet with a column for each tag, and gaps for values of bad quality."""
        time = None
        with suppress(RecordError):  # a time that is called twice is reported with the other problems
            time = sheet.find(self._called(TIME))
        if time is None or sheet.uneven or not len(sheet.frame):
            return sheet
        return historian.tidy(sheet, time, self.time_format, used=known)[0]

    def _places(self, sheet: Sheet, known: Mapping[str, str]) -> dict[str, int]:
        """Return the position of each column by name."""
        problems, places = [], {}
        for name, unit in known.items():
            try:
                found = sheet.find(name)
            except RecordError as error:
                problems.append(str(error))
                continue
            if found is None and name not in self._optional:
                there = ", ".join(parts_of(h)[0][:40] for h in sheet.headings[:12])
                problems.append(f"column {name!r} is missing; the headings are {there}")
            if found is None:
                continue
            places[name] = found
            given = parts_of(sheet.headings[found])[1]
            bare = sheet.headings[found].strip() == name  # it may itself contain brackets
            if given is not None and not bare and units.conversion(given, unit) is None:
                problems.append(
                    f"column {name!r} is in {units.named(given)}, expected {units.named(unit)}: convert it"
                )
        _refuse(problems)
        return places

    def _fill(
        self, sheet: Sheet, place: int, name: str, values: Float[np.ndarray, "K n"], column: int, unit: str
    ) -> Iterator[str]:
        """Fill a `column` of `values`, in `unit`; yield its problem, if it has one. The first is the time.

        Loggers write what changes: empty cells of inputs and references hold the value before.
        """
        try:
            if column == 0:
                found = times.instants(sheet, place, self.channels.time_unit, self.time_format)
                values[:, 0] = found.t - found.t.min() if found.stamped else found.t
                return
            filled = sheet.converted(place, unit)
        except RecordError as error:
            yield str(error)
            return
        held = name in self._optional or name in {self._called(c.name) for c in self.channels.u}
        bad = sheet.bad.get(place, {})
        lacks = ~np.isfinite(filled)
        empty = np.isnan(filled) & np.array([row not in bad for row in range(len(filled))])
        if held or sheet.own_times:
            # What holds before the first value is not known.
            lacks &= ~empty | ~np.logical_or.accumulate(np.isfinite(filled))
        holes = np.flatnonzero(lacks)
        if len(holes):
            got = sheet.got(place, int(holes[0]), filled[holes[0]])
            yield sheet.lacking(place, sheet.place(int(holes[0])), got, len(holes))
        elif not np.isfinite(filled).all():
            filled = bridge(values[:, 0], filled, held=held)
        values[:, column] = filled

    def _steps(self, t: Float[np.ndarray, " K"], sheet: Sheet) -> Iterator[str]:
        """Yield what is wrong with the steps of time."""
        if np.any(np.isnan(t)):
            return
        unit, back = self.channels.time_unit, times.steps_back(t)
        if len(back):
            k = int(back[0])
            yield f"{sheet.place(k + 1)}: {times.step_back_words(t, k, unit, len(back))}"
            return
        for k in map(int, times.gaps(t, self.max_gap)):
            words = times.gap_words(t, k, unit, 1)
            yield f"{sheet.place(k + 1)}: {words}: fill it, or enter the run as failed"

    def _outside(
        self, values: Float[np.ndarray, "K n"], known: Mapping[str, str], sheet: Sheet
    ) -> Iterator[str]:
        """Yield which columns have values outside the range of their sensor."""
        ranges = {self._called(name): limits for name, limits in self.ranges.items()}
        for column, (name, unit) in zip(values.T, known.items(), strict=True):
            low, high = ranges.get(name, (-_WIDEST, _WIDEST))
            low, high = max(low, -_WIDEST), min(high, _WIDEST)
            outside = np.flatnonzero((column < low) | (column > high))
            if len(outside):
                k = int(outside[0])
                yield (
                    f"{sheet.place(k)}, column {name!r}: {column[k]:g} {unit} is outside "
                    f"[{low:g}, {high:g}] {unit}{and_more(len(outside))}: is the unit right?"
                )

    def _of(self, values: Float[np.ndarray, "K m"], theta: Float[np.ndarray, " n"], end: End) -> Experiment:
        """Return an experiment without KPIs; `values` come from `_values`."""
        widths = [1, len(self.channels.x), len(self._measured), len(self.channels.u)]
        t, x, measured, u, y_ref = np.split(values, np.cumsum(widths), axis=1)
        count = len(values)
        return Experiment(
            theta=theta,
            t=t[:, 0],
            x=x,
            u=u,
            t_control=t[:, 0],
            u_control=u,
            y_ref=np.where(np.isnan(y_ref), np.reshape(self.y_ref, (1, -1)), y_ref),
            iterations=np.zeros(count, dtype=np.int64),
            solve_time=np.zeros(count),
            solved=np.ones(count, dtype=bool),
            channels=self.channels,
            end=end,
            y=self._outputs(x, measured),
        )

    def _outputs(
        self, x: Float[np.ndarray, "K n_x"], measured: Float[np.ndarray, "K m"]
    ) -> Float[np.ndarray, "K n_y"] | None:
        """Return the outputs of a record; None if all of them are states."""
        if not self._measured:
            return None
        names = [(c.name, units.plain(c.unit)) for c in (*self.channels.x, *self._measured)]
        places = [names.index((c.name, units.plain(c.unit))) for c in self.channels.y]
        return np.hstack([x, measured])[:, places]


def _compute(kpis: Callable[[Experiment], Mapping[str, float]], made: Experiment) -> dict[str, float]:
    try:
        return {str(name): float(value) for name, value in compute(kpis, made).items()}
    except Exception as error:
        # The user's own function can raise anything; the record or the function is the cause.
        raise RecordError(
            "the scenario cannot compute the KPIs of this record "
            f"({type(error).__name__}: {error}): fix the record or the scenario"
        ) from error


def _refuse(problems: list[str]) -> None:
    if not problems:
        return
    more = [f"and {len(problems) - _MOST_LISTED} more"] if len(problems) > _MOST_LISTED else []
    raise RecordError("; ".join([*problems[:_MOST_LISTED], *more]))


class _RigRun(Run):
    """A run that a person does; its experiment is read from the record that they supply."""

    waits = True

    def __init__(self, rig: Rig, theta: Float[np.ndarray, " n"]) -> None:
        self._rig, self._theta = rig, theta
        self._given: Given | None = None

    def advance(self) -> Experiment | None:
        if self._given is None:
            return None
        return self._rig.read(self._given.content, self._theta, unsafe=self._given.unsafe)

    def supply(self, given: Given | tuple[Change, ...]) -> None:
        assert isinstance(given, Given)
        self._given, self.waits = given, False
