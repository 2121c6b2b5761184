"""Tidy a table as historians write it: row numbers, values of bad quality, one row for each tag."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import RecordError
from prefcal_env.wording import and_more, labeled

from .sheet import Sheet, is_bad, with_gaps
from .times import Clock, clock_of, other_times

NO_HEADING = "no heading"
_COUNTERS = re.compile(
    r"|unnamed: [\d.]+|index|no\.?|nr\.?|#|row|record|sample|run|trial|experiment|id", re.IGNORECASE
)
"""What columns of row numbers are called: often nothing, which pandas reads as "Unnamed: 0"."""


def tidy(
    sheet: Sheet,
    time: int,
    time_format: str | None = None,
    *,
    used: Collection[str] = (),
    repeated: bool = False,
) -> tuple[Sheet, int]:
    """Return a table with one column for each signal and gaps for bad values, and where its time is.

    Args:
        time: Number of the column with the time.
        time_format: Format of time stamps as for `datetime.strptime`; None for ISO 8601.
        used: Names of columns that somebody asks for: these are what they seem.
        repeated: Whether a tag may have several values at one time, of which the last one counts.

    Raises:
        RecordError: If a table of one row for each tag holds what is no number or no time.
    """
    if sheet.own_times:
        return sheet, time  # it is tidied
    taken = {time, *(i for i in range(len(sheet.headings)) if sheet.name(i) in used)}
    aside = {i: "row numbers" for i in row_numbers(sheet) if i not in taken}
    aside |= {
        i: NO_HEADING for i, h in enumerate(sheet.headings) if not h.strip() and i not in {*aside, time}
    }
    aside |= {i: "another time" for i in other_times(sheet, time) if i not in taken}
    sheet = replace(sheet, aside=aside)
    every = [i for i in range(len(sheet.headings)) if i not in {*taken, *aside}]
    poor = {i: rows for i in every if (rows := _poor(sheet, i)) is not None}
    sheet = replace(sheet, aside={**aside, **dict.fromkeys(poor, "quality")})
    long = _Long.of(sheet, time)
    beside = {time} if long is None else {time, long.tag, long.unit}
    sheet = _without_poor(sheet, poor, beside)
    return (sheet, time) if long is None else (long.wide(sheet, time_format, repeated=repeated), 0)


def row_numbers(sheet: Sheet) -> Iterator[int]:
    """Yield the columns that number the rows, as an index of pandas does."""
    for i, heading in enumerate(sheet.headings):
        values = sheet.frame[i]
        if _COUNTERS.fullmatch(heading.strip()) and values.dtype.kind in "iuf":
            numbers = values.to_numpy(dtype=float, na_value=np.nan)
            steps = np.diff(numbers)
            # A selection of rows keeps their numbers.
            whole = np.isfinite(numbers).all() and (np.mod(numbers, 1) == 0).all()
            if whole and ((steps == 1).all() or (i == 0 and (steps > 0).all())):
                yield i


# --- Make gaps of the values that a quality column calls bad.

_QUALITY = {"quality", "qual", "status", "validity", "valid", "good", "qc"}
_FINE = re.compile(r"(good|ok|valid|normal|g|true|uncertain|questionable|substituted|u)\b.*", re.IGNORECASE)
_POOR = re.compile(r"(b|false|not good|not ok|no)\b.*", re.IGNORECASE)


def _without_poor(
    sheet: Sheet, poor: Mapping[int, Int[np.ndarray, " M"]], beside: Collection[int | None]
) -> Sheet:
    """Return a sheet with gaps in the rows that quality columns call `poor`, but for columns `beside`."""
    if not poor:
        return sheet
    frame, bad = sheet.frame.copy(deep=False), {i: dict(cells) for i, cells in sheet.bad.items()}
    every = [i for i in range(len(sheet.headings)) if i not in {*beside, *sheet.aside}]
    for i, rows in poor.items():
        owner = _owner(sheet, i)
        words = sheet.frame[i].ffill()
        for j in every if owner is None else (owner,):
            there = [row for row in rows.tolist() if not sheet.frame[j].isna().iloc[row]]
            frame[j] = frame[j].mask(np.isin(np.arange(len(frame)), rows))
            bad.setdefault(j, {}).update({row: f"quality {_tag(words.iloc[row])[:40]}" for row in there})
    return replace(sheet, frame=frame, bad=bad)


def _owner(sheet: Sheet, column: int) -> int | None:
    """Return the column whose name begins that of a quality column; None if it is that of all."""
    name = sheet.name(column)
    begin = [i for i in range(len(sheet.headings)) if i != column and 0 < len(sheet.name(i)) < len(name)]
    begin = [i for i in begin if name.startswith(sheet.name(i)) and not name[len(sheet.name(i))].isalnum()]
    return max(begin, key=lambda i: len(sheet.name(i)), default=None)


def _poor(sheet: Sheet, column: int) -> Int[np.ndarray, " M"] | None:
    """Return the rows that a quality column calls bad; None if it is no such column."""
    words = re.findall(r"[^\W_]+", sheet.name(column).lower())
    if not words or not (words[-1] in _QUALITY or "quality" in words):
        return None
    values = sheet.frame[column].ffill()
    if values.dtype.kind in "iufb":
        numbers = np.nan_to_num(values.to_numpy(dtype=float, na_value=np.nan), nan=192.0)
        poor = _poor_codes(numbers, {*words})
        return None if poor is None else np.flatnonzero(poor)
    cells = values.fillna("good").astype(str).str.strip()
    known = {cell: bool(_POOR.fullmatch(cell)) or is_bad(cell) for cell in cells.unique()}
    if not all(poor or _FINE.fullmatch(cell) for cell, poor in known.items()):
        return None
    return np.flatnonzero(cells.map(known).to_numpy(dtype=bool))


def _poor_codes(codes: Float[np.ndarray, " K"], words: set[str]) -> np.ndarray | None:
    """Return which codes of quality are bad; None if they are none that are known."""
    there = {*codes.tolist()}
    if there in ({0.0, 1.0}, {1.0}) and "status" not in words:
        return np.asarray(codes == 0)  # flags of good values
    if not words & {"quality", "qual", "qc"} or not np.isfinite(codes).all() or np.mod(codes, 1).any():
        return None
    if there == {0.0} or codes.max() >= 2**30:  # of OPC UA, where the two highest bits tell
        return np.asarray(codes >= 2**31)
    if there <= {*map(float, range(256))} and codes.max() >= 192:  # of OPC DA: 192 and above are good
        return np.asarray(codes < 64)
    return None


# --- Make columns of a table that has one row for each tag.

_TAGS = (
    "tag;tagname;tag name;tag path;tagpath;tag id;tagid;varname;var name;"
    "field;entity id;variable;signal;signal name;channel;point;point name;"
    "data point;datapoint;sensor;sensor id;metric;item;parameter;series;node;node id;nodeid;measurement;name;"
    "source;id;key"
)
"""Names of columns with tags, the surest first."""
_VALUES = "value;val;values;reading;state;measured value;numeric value;varvalue;var value;data;v"


@dataclass(frozen=True, slots=True, eq=False)
class _Long:
    """The columns of a table that has one row for each tag."""

    time: int
    tag: int
    value: int
    unit: int | None
    tags: Any  # the tag of each row, a pandas Series of text

    @classmethod
    def of(cls, sheet: Sheet, time: int) -> "_Long | None":
        """Return where they are; None if each signal has a column of its own."""
        names: dict[str, int] = {}
        for i in range(len(sheet.headings)):
            if i != time and i not in sheet.aside:
                spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", sheet.name(i)).lower()  # of a heading as TagName
                names.setdefault(" ".join(re.findall(r"[^\W_]+", spaced)), i)
        tag = next((names[name] for name in _TAGS.split(";") if name in names), None)
        value = next((names[name] for name in _VALUES.split(";") if name in names), None)
        if tag is None or value is None:
            tag, value = _by_repetition(sheet, time, [*names.values()])
        if tag is None or value is None or tag == value:
            return None
        tags = sheet.frame[tag].map(_tag, na_action="ignore")
        if tags.nunique() > max(len(tags) / 2, 1):
            return None  # names of events
        unit = next((names[n] for n in ("unit", "units", "uom", "engineering units") if n in names), None)
        return cls(time, tag, value, unit, tags)

    def wide(self, sheet: Sheet, time_format: str | None, *, repeated: bool) -> Sheet:
        """Return the table with a column for each tag, and its rows in the order of time."""
        import pandas as pd

        signals, left_out = self._signals(sheet, time_format)
        t, places = _common_times(signals)
        several = sum(len(each) - len(np.unique(each)) for each in places)
        if several and not repeated:
            raise RecordError(
                f"{several} times a tag of column {sheet.name(self.tag)!r} has several values at one time: "
                "if this is one run, give allow=('duplicates',) to keep the last one"
            )
        columns: dict[int, Any] = {0: t if signals[0].counted else pd.to_timedelta(t, unit="s")}
        bad = {}
        for i, (signal, rows) in enumerate(zip(signals, places, strict=True), start=1):
            columns[i] = np.full(len(t), np.nan)
            columns[i][rows] = signal.values
            bad[i] = {int(rows[k]): words for k, words in signal.bad.items()}
        lines = None
        if sheet.lines is not None:
            lines = np.full(len(t), sheet.lines.max())
            np.minimum.at(
                lines, np.concatenate(places), sheet.lines[np.concatenate([s.rows for s in signals])]
            )
        headings = (sheet.headings[self.time], *(labeled(s.name, s.unit) for s in signals))
        said = (*sheet.said, *_told(sheet.name(self.tag), signals, left_out, several))
        return Sheet(headings, pd.DataFrame(columns), lines, bad=bad, said=said, own_times=True)

    def _signals(self, sheet: Sheet, time_format: str | None) -> tuple[list["_Signal"], list[str]]:
        """Return the tags that have numbers, and the names of the others."""
        signals, left_out = [], []
        every = self.tags.dropna()
        blocks = (every != every.shift()).sum() == every.nunique()  # one tag after the other
        clock = None if blocks else _common_clock(sheet, self.time, time_format)
        for tag in every.unique():
            rows = np.flatnonzero(self.tags == tag)
            own = None if clock is None else replace(clock, s=clock.s[rows])
            signal = _Signal.of(self, sheet, rows, str(tag), time_format, own)
            if signal is None:
                left_out.append(str(tag))
            else:
                signals.append(signal)
        if not signals:
            raise RecordError(f"none of the tags in column {sheet.name(self.tag)!r} has numbers")
        if jumped := [s.name for s in signals if bool(s.said) != bool(signals[0].said)]:
            raise RecordError(
                f"the clock jumps, but the rows of {jumped[0]!r} do not show when: sort all rows by time, or "
                "write time stamps with their distance from UTC, such as 2026-10-25T02:00:00+01:00"
            )
        return signals, left_out


def _common_clock(sheet: Sheet, time: int, time_format: str | None) -> Clock | None:
    """Return what the clock of all rows says, if they are in its order; None if each tag has its own.

    A tag that is logged now and then does not show alone when a clock was changed.
    """
    column = sheet.frame[time]
    new = np.asarray(column != column.shift())
    try:
        clock = clock_of(sheet.take(np.flatnonzero(new)), time, time_format)
    except RecordError:
        return None  # the rows are not in the order of time
    if clock is None or not ((np.diff(clock.s) >= 0).all() or (np.diff(clock.s) <= 0).all()):
        return None
    return replace(clock, s=clock.s[np.cumsum(new) - 1])


def _common_times(
    signals: Sequence["_Signal"],
) -> tuple[Float[np.ndarray, " M"], list[Int[np.ndarray, " K"]]]:
    """Return the times of all signals in one order, and the place of each signal's times among them."""
    origin = min((s.day for s in signals if s.day is not None), default=None)
    times = [s.t if origin is None or s.day is None else s.t + 86400.0 * (s.day - origin) for s in signals]
    if origin is not None:
        first = min(float(each.min()) for each in times)
        times = [each - first for each in times]
    t = np.unique(np.concatenate(times))
    return t, [np.searchsorted(t, each) for each in times]


def _told(tag: str, signals: Sequence["_Signal"], left_out: Sequence[str], several: int) -> Iterator[str]:
    """Yield what was made of a table with one row for each tag."""
    yield f"one row for each {tag!r}: now columns {', '.join(s.name for s in signals)}"
    if left_out:
        yield f"tags without numbers left out: {', '.join(left_out[:5])}{and_more(len(left_out[4:]))}"
    if several:
        yield f"of several values of a tag at one time only the last one is kept ({several} left out)"
    yield from next((s.said for s in signals if s.said), ())


def _tag(value: Any) -> str:
    """Return a tag as text: 101, although pandas reads 101.0."""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value).strip()


def _by_repetition(sheet: Sheet, time: int, there: list[int]) -> tuple[int | None, int | None]:
    """Return the only column of text and of numbers, if times repeat but not for any one text."""
    kinds = {i: sheet.frame[i].dtype.kind in "iuf" for i in there}
    text, numeric = [i for i in there if not kinds[i]], [i for i in there if kinds[i]]
    if len(text) != 1 or len(numeric) != 1:
        return None, None
    both = sheet.frame[[time, text[0]]]
    is_long = both[time].duplicated().any() and not both.duplicated().any() and both[text[0]].nunique() > 1
    return (text[0], numeric[0]) if is_long else (None, None)


@dataclass(frozen=True, slots=True, eq=False)
class _Signal:
    """The rows of one tag."""

    name: str  # the tag
    unit: str  # unit of its values; "" if no column tells
    rows: Int[np.ndarray, " K"]  # its rows in the table, shape (K,)
    # Times, shape (K,): seconds since the midnight of `day`, or numbers as they stand
    t: Float[np.ndarray, " K"]
    day: int | None  # day of that midnight, in days since 1970; None without a date
    counted: bool  # whether times are numbers
    values: Float[np.ndarray, " K"]  # values at `t`, shape (K,); NaN for gaps
    bad: dict[int, str]  # what was written instead of a good value, by row
    said: tuple[str, ...]  # what was made of the clock, in words

    @classmethod
    def of(
        cls,
        long: _Long,
        sheet: Sheet,
        rows: Int[np.ndarray, " K"],
        name: str,
        time_format: str | None,
        clock: Clock | None,
    ) -> "_Signal | None":
        """Read the rows of a tag, whose `clock` may be that of all rows; None if it has no numbers."""
        part = with_gaps(sheet.take(rows), ())
        try:
            values = part.numbers(long.value)
        except RecordError:
            if part.is_almost_numeric(long.value):
                raise  # it says which cell holds no number
            return None
        if not np.isfinite(values).any():
            return None
        clock = clock or clock_of(part, long.time, time_format)
        t = part.numbers(long.time) if clock is None else clock.s
        units = [] if long.unit is None else [*part.frame[long.unit].dropna().unique()]
        return cls(
            name,
            str(units[0]).strip() if len(units) == 1 else "",
            rows,
            t,
            None if clock is None else clock.day,
            clock is None,
            values,
            dict(part.bad.get(long.value, {})),
            () if clock is None else clock.said,
        )
