"""Find the time of a table and read it: numbers in any unit, time stamps, times of day."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env import units
from prefcal_env.errors import RecordError
from prefcal_env.wording import and_more

from .sheet import Sheet, almost_a_number, parts_of

MAX_GAP = 10.0  # longest step of time that is no gap, in median steps

# --- Find the column with the time by the words of its heading.

_ALONE = (
    "ms msec millis micros nanos sec secs seconds minutes hours days milliseconds microseconds nanoseconds"
)
"""Units that are a whole heading; "min" is a minimum, "s" and "h" may be anything."""
_TIMES = (
    "time timestamp datetime elapsed uptime epoch tow zeit zeitstempel zeitpunkt uhrzeit temps horodatage "
    "tiempo hora tijd tid czas время 时间 時間 시간"
)
_BESIDE = (
    "absolute abs date dd elapsed epoch gmt gps hh host in last local log logged mm of posix real record "
    "recorded rel relative server sim simulation source ss stamp system the unix utc week yyyy"
)
"""Words beside those of `_TIMES` that leave it a time; a settling time is none."""
_PHRASES = ("last changed", "last updated", "utc", "t stamp")
_WORD = re.compile(r"[^\W_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_INDEX = 6  # rank of a column called index


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
    raise RecordError(f"{what}: name the right one with --time, in Python time=...; there are {there}")


def usual_time_columns(sheet: Sheet) -> list[int]:
    """Return the numbers of the columns that are most likely the time by their headings."""
    ranks = _ranks(sheet)
    return [i for i, rank in ranks.items() if rank == min(ranks.values())]


def other_times(sheet: Sheet, time: int) -> list[int]:
    """Return the numbers of the columns that surely are times, beside the one that is used."""
    # A "t" beside the time may be a temperature.
    return [i for i, rank in _ranks(sheet).items() if i != time and rank not in (4, _INDEX)]


def _ranks(sheet: Sheet) -> dict[int, int]:
    """Return how likely columns are the time, 0 the likeliest; those that are not are missing."""
    every = {i: _rank(sheet, i) for i in range(len(sheet.headings))}
    return {i: rank for i, rank in every.items() if rank is not None}


def _rank(sheet: Sheet, column: int) -> int | None:
    """Return how likely a column is the time, from `time` itself down to a mere index; None if it is not."""
    name, unit = parts_of(sheet.headings[column])
    words, spelled = _words(name)
    if words == ["t"]:
        lower = unit is None and name[:1] == "t"  # T is a temperature
        return 4 if lower or units.seconds(unit or "") is not None else None
    if words in (["time"], ["time", "string"]):
        return 0 if spelled is None else 1
    times, beside = {*_TIMES.split()}, {*_BESIDE.split()}
    is_time = bool(times & {*words}) and {*words} <= times | beside
    if is_time or " ".join(words) in _PHRASES or name == "ts":
        return 2
    if words in (["date"], ["datum"], ["fecha"]) or (not words and spelled is not None):
        return 3
    if sheet.frame[column].dtype.kind in "mM" or (not name and _holds_stamps(sheet, column)):
        return 5
    return _INDEX if words == ["index"] else None


def _words(name: str) -> tuple[list[str], str | None]:
    """Return the words of a heading without its unit of time, and that unit."""
    words = [word.lower() for word in _WORD.findall(_CAMEL.sub(" ", name))]
    unit = None
    last = words[-1] if words else ""
    if units.seconds(last) is not None and (len(words) > 1 or last in _ALONE.split()):
        # T_min is the lowest temperature, t_min may be a time in minutes.
        unit = None if words[0] == "t" and name[:1] == "T" else units.plain(last)
        words = words if unit is None else words[:-1]
    if "since" in words:
        words = words[: words.index("since")]
    return words, unit


def _holds_stamps(sheet: Sheet, column: int) -> bool:
    """Return whether a column without a heading is an index of pandas, but no row numbers."""
    cells = sheet.frame[column].dropna()
    if cells.dtype.kind in "iuf":
        whole = (cells % 1 == 0).all() and abs(cells).max() < 9e8
        return column == 0 and not whole and bool((cells.diff().dropna() > 0).all())
    return len(cells) > 0 and re.match(r"\d{4}-\d\d-\d\d\b|-?\d+ days", str(cells.iloc[0])) is not None


def time_unit_of(sheet: Sheet, column: int, given: str | None, said: str | None = None) -> str:
    """Return the unit of the experiment's time: `given`, or the heading's, or else seconds.

    Nobody reads settling times in what loggers count: of time_ms and finer, the unit is s. `said` is the
    unit of the numbers in the column, for a heading without one.
    """
    name, unit = parts_of(sheet.headings[column])
    spelled = _words(name)[1]
    found = given or unit or said or (spelled if spelled in ("min", "h", "d") else "s")
    return units.plain(found) if units.seconds(found) is not None else found


# --- Read the time of each row.


@dataclass(frozen=True, slots=True, eq=False)
class Instants:
    """The time of each row of a table."""

    t: Float[np.ndarray, " K"]  # times in `unit`, shape (K,)
    unit: str  # their unit
    read: str = ""  # unit in which numbers were read, if it is another one or none is given; else ""
    said: tuple[str, ...] = ()  # what else was made of a clock, in words
    stamped: bool = False  # whether they are instants of a calendar, of which only differences tell something

    def words(self, sheet: Sheet, time: int) -> str:
        """Return which column was taken for the time, and in which unit it was read."""
        name = repr(sheet.name(time)) if sheet.name(time) else f"column {time + 1}"
        if self.read and self.read != self.unit:
            return f"time from {name}, read as {self.read}, in {self.unit}"
        return f"time from {name} in {self.unit}{', as no unit is given' if self.read else ''}"


def instants(
    sheet: Sheet, column: int, unit: str | None, time_format: str | None = None, said: str | None = None
) -> Instants:
    """Return the time of each row.

    Time stamps count from the earliest one; those with time zones are converted to UTC. A local
    clock that steps by an hour, and one of 12 hours, is read on where the rows leave no doubt.

    Args:
        column: Number of the column with the time.
        unit: Unit of time of the experiment; None for that of the heading, or seconds.
        time_format: Format of time stamps as for `datetime.strptime`; None for ISO 8601.
        said: Unit of the numbers in the column, for a heading without one.

    Raises:
        RecordError: If a cell is empty or no time, units cannot be converted, numbers may be in
            several units, or a clock steps back.
    """
    wanted = time_unit_of(sheet, column, unit, said)
    clock = clock_of(sheet, column, time_format)
    if clock is None:
        return _of_numbers(sheet, column, wanted, unit, said)
    if units.seconds(wanted) is None and unit is None:
        wanted = "s"  # of a heading such as "time [HH:MM:SS]"
    s = clock.s if clock.day is None else clock.s - clock.s.min()
    return Instants(s / _seconds(wanted), wanted, said=clock.said, stamped=True)


def _of_numbers(sheet: Sheet, column: int, wanted: str, given: str | None, said: str | None) -> Instants:
    """Return the times in a column of numbers."""
    found, name = sheet.numbers(column), sheet.name(column)
    check_filled(sheet, column, ~np.isfinite(found))
    bracketed = parts_of(sheet.headings[column])[1] or (None if said is None else sheet.unit(column, said))
    if bracketed and units.seconds(bracketed) is not None:
        bracketed = units.plain(bracketed)
    words, spelled = _words(name)
    stated = bracketed or spelled
    # Whoever asks for a finer unit than seconds may have the time since a start.
    counted = None if stated or given in ("ns", "us", "ms") else _counted(found)
    source, unsaid = stated or counted or given or "s", not (stated or counted or given)
    if not (stated or counted) and source == "s":  # who wants seconds may have others
        _check_steps(name, found, plain=words in (["time"], ["t"], ["index"], []))
    _check_order(sheet, found, source)
    t = found if source == wanted else _convert(found, _seconds(source), _seconds(wanted))
    length = units.seconds(source) or 0.0
    if length >= 1 and len(t) and np.abs(found).max() * length > _AGES:
        raise RecordError(
            f"column {name!r} would reach {np.abs(found).max():g} {source}, thousands of years: write its "
            f"unit into the heading, as in '{name} [ms]'"
        )
    read = source if not bracketed and (source != wanted or unsaid) else ""
    return Instants(t, wanted, read, stamped=counted is not None)


def _convert(t: Float[np.ndarray, " K"], source: float, wanted: float) -> Float[np.ndarray, " K"]:
    """Return times in units of `source` seconds in units of `wanted` seconds."""
    # Dividing keeps 1760000000500 ms exactly half a second after 1760000000000 ms.
    return t / (wanted / source) if wanted > source else t * (source / wanted)


_AGES = 1e11  # 3,000 years in seconds
_EPOCH = (946684800.0, 4102444800.0)  # the years 2000 to 2100 in seconds since 1970
_SERIAL = ((10957.0, 73050.0), (730486.0, 767010.0))  # in days since 1970 or 1900, and since the year 0


def _counted(found: Float[np.ndarray, " K"]) -> str | None:
    """Return the unit in which numbers count from a date; None if they do not.

    Such as seconds or milliseconds since 1970, or days since 1900.
    """
    if not len(found):
        return None
    low, high = float(found.min()), float(found.max())
    for unit in ("s", "ms", "us", "ns"):
        length = _seconds(unit)
        if _EPOCH[0] <= low * length and high * length <= _EPOCH[1]:
            return unit
    if not any(first <= low and high <= last for first, last in _SERIAL):
        return None
    # In days, short steps or whole tenths of a second are no round numbers: 46300.375 is followed by
    # 46300.37501157.
    steps = np.diff(np.unique(found))
    steps = steps[steps < 1.0]
    if not len(steps) or (np.abs(steps * 1e4 - np.round(steps * 1e4)) < 1e-3).all():
        return None
    tenths = steps * 864000
    return "d" if np.median(steps) < 1e-3 or (np.abs(tenths - np.round(tenths)) < 0.02).all() else None


def _check_steps(name: str, found: Float[np.ndarray, " K"], *, plain: bool) -> None:
    """Refuse numbers without a unit with steps that few choose in seconds.

    Counters of milliseconds and finer are whole numbers with long steps, and with jitter if a clock
    made them. A column that is just called time (`plain`) is in seconds if its times are round, or
    as irregular as those that people write down.

    Raises:
        RecordError: If they are rather in another unit.
    """
    steps = np.diff(np.unique(found))
    if not len(steps) or not np.equal(np.mod(found, 1), 0).all():
        return
    usual = float(np.median(steps))
    if usual < 100 or not usual % 60:
        return
    regular = np.mean(np.abs(steps - usual) <= 0.1 * usual) > 0.9
    if not plain or (regular and (usual >= 1000 or np.mod(found, usual).any())):
        raise RecordError(
            f"column {name!r} has steps of {usual:g} and no unit of time: write it into the heading, as in "
            f"'{name} [ms]' or '{name} [s]', or give units={{{name!r}: 'ms'}}"
        )


def check_filled(sheet: Sheet, column: int, empty: np.ndarray) -> None:
    """Refuse rows without a time."""
    if empty.any():
        row = int(np.argmax(empty))
        raise RecordError(
            f"{sheet.place(row)}, column {sheet.name(column)!r}: expected a time, "
            f"got nothing{and_more(int(empty.sum()))}: fill it, or remove the row"
        )


def _seconds(unit: str) -> float:
    found = units.seconds(unit)
    if found is None:
        raise RecordError(f"the unit of time {unit!r} cannot be converted: use one of s, ms, us, min, h, d")
    return found


# --- Read time stamps, times of day and durations, which are text or types of pandas.

_CLOCK = re.compile(r"^(\d+):([0-5]\d)(?::([0-5]\d(?:[.,]\d*)?))?$")
"""Time of day, with seconds or without, or hours, minutes and seconds of a stopwatch."""
_MERIDIEM = r"(?i)^(.*?)\b(0?[1-9]|1[0-2])(:[0-5]\d(?::[0-5]\d(?:[.,]\d+)?)?)\s*([ap])\.?\s?m\.?$"
_ZONE = r"(?:Z|UTC|GMT|[+-]\d\d:?\d\d)$"
_MINUTES = r"^(\d+):([0-5]\d[.,]\d+)$"  # how spreadsheets write short times
_DATED = r"^(\d{1,2})([./-])(\d{1,2}|[A-Za-z]{3})\2(\d{4}|\d\d)(?:[ T]+(.*))?$"  # the year is last
_NAMES = "jan feb mar apr may jun jul aug sep oct nov dec"
_MONTHS = {name: str(number) for number, name in enumerate(_NAMES.split(), start=1)}
_DAYS = r"^(-?\d+) days?,? (.*)$"  # how pandas and Python write durations
_HOUR, _HALF_DAY, _DAY = 3600.0, 43200.0, 86400.0


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """What a clock showed, in seconds, without its jumps."""

    s: Float[np.ndarray, " K"]  # seconds, shape (K,), since a midnight, or since a stopwatch was started
    day: int | None = None  # day of that midnight, in days since 1970; None if the clock shows no date
    said: tuple[str, ...] = ()  # which jumps were read on, in words


def clock_of(sheet: Sheet, column: int, time_format: str | None) -> Clock | None:
    """Return what a column of time stamps, times of day or durations says; None if of numbers.

    Raises:
        RecordError: If a cell is empty or no time, or the clock steps back.
    """
    import pandas as pd

    values = sheet.frame[column]
    check_filled(sheet, column, np.asarray(values.isna()))
    if pd.api.types.is_timedelta64_dtype(values.dtype):
        return Clock(values.dt.total_seconds().to_numpy(dtype=float))
    if pd.api.types.is_datetime64_any_dtype(values.dtype):
        return _date(sheet, values, zoned=values.dt.tz is not None)
    if pd.api.types.is_numeric_dtype(values.dtype):
        return None
    text = values.astype(str).str.strip()
    if time_format is not None:
        return _stamps(sheet, column, text, time_format)
    days = text.str.extract(_DAYS) if re.match(_DAYS, text.iloc[0]) else None
    if days is not None and days[0].notna().all():
        return Clock(_time_of_day(days[1]) + _DAY * days[0].astype(float).to_numpy())
    text = _in_24_hours(text)
    if text.str.match(_MINUTES).all():
        parts = text.str.replace(",", ".").str.split(":", expand=True).astype(float)
        s = 60.0 * parts[0].to_numpy() + parts[1].to_numpy()  # it may begin anew after an hour
        return Clock(s + _HOUR * np.cumsum(np.append(0, np.diff(s) < -_HOUR / 2)))
    if text.str.match(_CLOCK).all():
        s = _time_of_day(text)
        if (s[0] == 0 or s.max() >= _DAY) and not text.str.count(":").gt(1).any():
            raise RecordError(
                f"column {sheet.name(column)!r}: {text.iloc[-1]!r} may be hours and minutes, or minutes and "
                "seconds: write 00:03:20, or give time_format='%M:%S' or '%H:%M'"
            )
        # A step back by more than half a day passes midnight.
        return _steady(sheet, s + _DAY * np.cumsum(np.append(0, np.diff(s) < -_HALF_DAY)), None)
    return None if almost_a_number(text.iloc[0]) else _stamps(sheet, column, text, None)


def _time_of_day(text: Any) -> Float[np.ndarray, " K"]:
    """Return times such as 09:30:00 in seconds."""
    parts = text.str.extract(_CLOCK)
    parts[2] = parts[2].fillna("0")
    each = (parts[i].str.replace(",", ".").astype(float).to_numpy() for i in range(3))
    return np.asarray(sum(scale * part for scale, part in zip((_HOUR, 60.0, 1.0), each, strict=True)))


def _in_24_hours(text: Any) -> Any:
    """Return text with 24 hours instead of AM and PM, if there are any."""
    if not re.match(_MERIDIEM, text.iloc[0]):
        return text
    parts = text.str.extract(_MERIDIEM)
    there = parts[3].notna()
    hour = parts[1].fillna("0").astype(int) % 12 + 12 * (parts[3].str.lower() == "p")
    read = parts[0] + hour.map("{:02d}".format) + parts[2]
    return read.where(there, text)


def _date(sheet: Sheet, stamps: Any, *, zoned: bool) -> Clock:
    """Return what time stamps of pandas say, from the midnight before the earliest one."""
    import pandas as pd

    midnight = stamps.min().normalize()
    s = np.asarray((stamps - midnight).dt.total_seconds().to_numpy(dtype=float))
    day = (midnight.tz_localize(None) - pd.Timestamp(0)).days
    return Clock(s, day) if zoned else _steady(sheet, s, day)


def _stamps(sheet: Sheet, column: int, text: Any, time_format: str | None) -> Clock:
    """Return what time stamps in text say."""
    import pandas as pd

    text = text.str.replace(r"(:\d\d),(\d+)", r"\1.\2", regex=True)
    if time_format is None and text.str.match(_DATED).mean() > 0.5:
        found = _written(sheet, column, text)
    else:
        try:
            found = pd.to_datetime(text, format=time_format or "ISO8601", errors="coerce", utc=True)
        except ValueError as error:
            raise RecordError(f"time_format={time_format!r} is no format of time stamps: {error}") from error
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
            f"got {str(sheet.frame[column].iloc[row])[:40]!r}{and_more(int(wrong.sum()))}; "
            "give time_format='%d/%m/%Y %H:%M:%S' or the like"
        )
    zoned = "%z" in (time_format or "") or bool(text.str.contains(_ZONE).any())
    return _date(sheet, found, zoned=zoned)


def _written(sheet: Sheet, column: int, text: Any) -> Any:
    """Return time stamps such as 25.10.2026 9:30, 10/25/2026 09:30 or 25-Oct-26 09:30:00.

    Raises:
        RecordError: If it is not clear what is the month.
    """
    import pandas as pd

    first, sign, second, year, rest = (text.str.extract(_DATED)[i] for i in range(5))
    year = year.where(year.str.len() != 2, "20" + year)
    rest = rest.fillna("00:00").str.replace(r"^(\d):", r"0\1:", regex=True)

    def read(month: Any, day: Any) -> Any:
        iso = year + "-" + month.str.zfill(2) + "-" + day.str.zfill(2) + "T" + rest
        return pd.to_datetime(iso, format="ISO8601", errors="coerce", utc=True)

    if not second.str.isdigit().any():
        return read(second.str.lower().map(_MONTHS), first)
    fits = [read(second, first)]
    if not (sign == ".").all():  # dots come with the day first
        fits = [found for found in (read(first, second), *fits) if found.notna().all()] or fits
    # What is a day must not be taken for a month, which would leave a gap of a month.
    whole = [s for s in fits if not len(gaps(np.unique((s - s.min()).dt.total_seconds())))] or fits
    # Within one day, it does not matter.
    if len(whole) == 2 and not (whole[0] - whole[0].min()).equals(whole[1] - whole[1].min()):
        raise RecordError(
            f"column {sheet.name(column)!r}: {sheet.frame[column].iloc[0]!r} may begin with the day or the "
            "month: give time_format='%d/%m/%Y %I:%M:%S %p' or the like"
        )
    return whole[0]


# --- Read on where a local clock jumps: summer time ends or begins, or it has only 12 hours.


def _steady(sheet: Sheet, s: Float[np.ndarray, " K"], day: int | None) -> Clock:
    """Return seconds of a local clock without its jumps by an hour, or by half a day.

    A jump is read on if the usual step comes with it, and before and after it. Others stay.
    """
    steps = np.diff(s)
    if (steps < 0).sum() > len(steps) / 2:  # the latest row comes first
        turned = _steady(sheet.take(np.arange(len(s))[::-1]), s[::-1], day)
        return Clock(turned.s[::-1], day, turned.said)
    if not (steps > 0).any():
        return Clock(s, day)
    k = _half_day(sheet, s, steps)
    if k is not None:
        s = s[0] + np.append(0.0, np.cumsum(np.mod(steps, _HALF_DAY)))
        words = f"a clock of 12 hours without AM and PM, read on after {sheet.place(k)}"
        return Clock(s, day, (words,))
    k, jump = _summer_time(sheet, s, steps, day)
    if not jump:
        _check_order(sheet, s, "s")
        return Clock(s, day)
    which = "back by an hour at the end" if jump > 0 else "forward by an hour at the beginning"
    words = f"the clock steps {which} of summer time, after {sheet.place(k)}: bridged"
    return Clock(s + np.where(np.arange(len(s)) > k, jump, 0.0), day, (words,))


def _half_day(sheet: Sheet, s: Float[np.ndarray, " K"], steps: Float[np.ndarray, " M"]) -> int | None:
    """Return the first row after which a clock of 12 hours begins anew; None if it has 24 hours."""
    hours = s % _DAY // _HOUR
    if hours.min() < 1 or hours.max() >= 13:
        return None
    usual = np.median(steps[steps > 0])
    if usual >= _HOUR:
        return None
    # After 12:59:59 comes 01:00:00, and at midnight 12:00:00 of the next day after 11:59:59.
    anew = (steps < 0) & (hours[:-1] == 12)
    next_day = (steps > _DAY) & (hours[:-1] == 11) & (hours[1:] == 12)
    jumps = np.where(anew, steps + _HALF_DAY, np.where(next_day, steps - _DAY, np.inf))
    found = np.flatnonzero(jumps <= _NEAR * usual)
    if len(found) and np.mod(steps, _HALF_DAY).max() < _HALF_DAY / 2:
        return int(found[0])
    _refuse_unclear(sheet, jumps <= MAX_GAP * usual, "half a day")
    return None


def _summer_time(
    sheet: Sheet, s: Float[np.ndarray, " K"], steps: Float[np.ndarray, " M"], day: int | None
) -> tuple[int, float]:
    """Return the row after which the clock steps by an hour, and what to add from there on, or 0."""
    usual = np.median(steps[steps > 0])
    hours = s // _HOUR
    # At the end, 02:00:00 comes after 02:59:59; at the beginning, 03:00:00 after 01:59:59.
    back = (steps < 0) & (steps > -_HOUR) & (np.diff(hours) == 0)
    near = steps + _HOUR <= _NEAR * usual
    regular = (steps > 0) & (steps <= _NEAR * usual)
    beside = np.append(True, regular[:-1]) & np.append(regular[1:], True)
    clear = np.flatnonzero(back & near & beside)
    if len(clear) == 1:
        return int(clear[0]), _HOUR
    at_night = s[:-1] % _DAY < 4 * _HOUR
    if day is not None:
        at_night &= (day + s[:-1] // _DAY + 3) % 7 == 6  # a Sunday; 1970 began on a Thursday
    # It may be another order of rows, but hardly so when clocks are changed.
    _refuse_unclear(sheet, back & ((steps + _HOUR <= MAX_GAP * usual) | at_night), "an hour")
    forward = (steps > _HOUR) & (steps - _HOUR <= _NEAR * usual) & (np.diff(hours) == 2) & beside
    found = np.flatnonzero(forward & at_night)
    if day is None or len(found) != 1 or usual >= _HOUR:
        return 0, 0.0
    return int(found[0]), -_HOUR


_NEAR = 1.5  # largest step after a jump that leaves no doubt, in usual ones


def _refuse_unclear(sheet: Sheet, steps: np.ndarray, what: str) -> None:
    """Refuse steps back of a local clock that may be a jump and a gap, or rows in another order."""
    if steps.any():
        k = int(np.argmax(steps))
        raise RecordError(
            f"{sheet.place(k + 1)}: the clock steps back by about {what}, and a gap leaves open by how much: "
            "write time stamps with their distance from UTC, such as 2026-10-25T02:00:00+01:00"
        )


def _check_order(sheet: Sheet, s: Float[np.ndarray, " K"], unit: str) -> None:
    """Refuse a clock that was set back: sorted by time, what came after would mix with what came before.

    Sorting is right for a few rows that came late, blocks in another order, those that repeat rows,
    and those that hold other columns.
    """
    steps = np.diff(s)
    back = np.flatnonzero(steps < 0)
    if not 0 < len(back) <= _MOST_BLOCKS:
        return  # of more, rows came late, again and again
    ends = [*back[1:].tolist(), len(s) - 1]
    begin = 0
    for k, end in zip(back.tolist(), ends, strict=True):
        before, late, height = np.arange(k + 1), np.arange(k + 1, end + 1), k + 1 - begin
        begin = k + 1
        among = s[before][(s[before] >= s[k + 1]) & (s[before] <= s[end])]
        if min(height, len(late)) < _FEW or not len(among):
            continue
        late = late[(s[late] >= among.min()) & (s[late] <= among.max())]
        if not _agree(sheet, s, before, late):
            raise RecordError(
                f"{sheet.place(k + 1)}: the time steps back by {-steps[k]:g} {unit}, and other values have "
                "those times already: correct the times, or split the table if it holds several runs"
            )


_MOST_BLOCKS, _FEW = 20, 3


def _agree(sheet: Sheet, s: Float[np.ndarray, " K"], before: np.ndarray, late: np.ndarray) -> bool:
    """Return whether late rows repeat those of the same times, or fill other columns than all before."""
    filled = sheet.frame.iloc[before].notna().any() & sheet.frame.iloc[late].notna().any()
    if filled.sum() <= 1:  # the time alone
        return True
    order = before[np.argsort(s[before], kind="stable")]
    same = order[np.minimum(np.searchsorted(s[order], s[late]), len(order) - 1)]
    one, other = sheet.frame.iloc[same], sheet.frame.iloc[late]
    equal = one.to_numpy(dtype=object) == other.to_numpy(dtype=object)
    equal |= one.isna().to_numpy() | other.isna().to_numpy()
    return bool((s[same] == s[late]).all() and equal.all())


# --- Judge the steps of time.


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
