"""The time of a table: which column it is, in which unit it counts, and what a clock showed."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import from_frame
from prefcal_env.errors import RecordError
from prefcal_env.tables.sheet import sheet_of
from prefcal_env.tables.times import instants, usual_time_columns

SECONDS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
T = np.arange(0.0, 40.0, 0.5)
LEVEL = 30 - 10 * np.exp(-T / 5)


def table(heading, times):
    rows = (f'"{time}",{level!r},30\n' for time, level in zip(times, LEVEL.tolist(), strict=False))
    return f'"{heading}",T,T ref\n' + "".join(rows)


def read(text, **about):
    return from_frame(text, [1.0], **about)


def time_of(heading, times, **about):
    sheet = sheet_of(table(heading, times))
    (column,) = usual_time_columns(sheet)
    return instants(sheet, column, None, **about)


PLAIN = read(table("time [s]", T))


def same_kpis(e):
    factor = SECONDS[e.channels.time_unit]
    assert [channel.name for channel in e.channels.y] == ["T"]
    assert e.duration * factor == pytest.approx(39.5)
    assert e.kpis["settling time of T"] * factor == pytest.approx(PLAIN.kpis["settling time of T"])
    assert e.kpis["overshoot of T"] == PLAIN.kpis["overshoot of T"]


HEADINGS = {
    "time_s": "s",
    "TIME": "s",
    "elapsed": "s",
    "uptime": "s",
    "Elapsed Time": "s",
    "Time since start (s)": "s",
    "Time in seconds": "s",
    "time/s": "s",
    "t_s": "s",
    "seconds": "s",
    "sim time [s]": "s",
    "time_ms": "ms",
    "timeMs": "ms",
    "tow(msec)": "ms",
    "Time (msec)": "ms",
    "millis": "ms",
    "timestamp_us": "us",
    "Time_nanoseconds": "ns",
    "time_min": "min",
    "Time (min)": "min",
    "Time(hr)": "h",
    "hours": "h",
    "time_days": "d",
}


@pytest.mark.parametrize("heading", HEADINGS)
def test_the_words_of_a_heading_tell_the_time_and_its_unit(heading):
    unit = HEADINGS[heading]
    e = read(table(heading, T / SECONDS[unit]))
    assert e.channels.time_unit in (unit, "s")
    same_kpis(e)


@pytest.mark.parametrize("heading", ["settling time", "T1", "time2", "dead_time_s", "T_min", "T", "lifetime"])
def test_other_headings_are_not_taken_for_the_time(heading):
    assert usual_time_columns(sheet_of(table(heading, T))) == []
    with pytest.raises(RecordError, match="no column is called time: name the right one with --time"):
        read(table(heading, T))


@pytest.mark.parametrize(
    ("rows", "end"),
    [
        ("Zeit;Ventil\n0,5;1\n1;1\n2,5;4\n", 2.0),
        ("Ventil;Zeit [min]\n1;0,5\n4;1\n2;2,5\n", 2.0),
        ("Uhrzeit;Ventil\n08:00:00;1\n08:00:20;1\n08:01:10;4\n", 70.0),
        ("temps;vanne\n0;1\n1;1\n2;4\n", 2.0),
        ("Zeile;Ventil\n1;0,5\n2;1\n3;2,5\n", None),
        ("Energie [kWh];Ventil\n1;0,5\n2;1\n3;2,5\n", None),
        ("T;Ventil\n1;0,5\n2;1\n3;2,5\n", None),
    ],
)
def test_time_is_known_in_other_languages_and_what_only_increases_is_not_taken_for_it(rows, end):
    if end is None:
        with pytest.raises(RecordError, match=r"--time, in Python time=\.\.\.; there are"):
            read(rows)
    else:
        assert read(rows).t.tolist()[-1] == end


@pytest.mark.parametrize(
    "better", ["time_s", "timestamp", "elapsed_ms", "uptime", "Time(hr)", "tow(msec)", "t"]
)
@pytest.mark.parametrize("temperature", ["T", "t"])
def test_a_temperature_beside_a_better_time_is_an_output(better, temperature):
    if better == temperature:
        pytest.skip("is the time")
    rows = "".join(f"{20 + 0.5 * k},{60},{k}\n" for k in range(30))
    e = read(f"{temperature},power,{better}\n{rows}")
    assert [channel.name for channel in e.channels.y] == [temperature, "power"]


def test_of_several_times_the_others_are_no_outputs():
    e = read("time_s,timestamp,uptime_ms,T\n" + "".join(f"{k},{1760000000 + k},{k},{k}\n" for k in range(9)))
    assert [channel.name for channel in e.channels.y] == ["T"]
    asked = read("time,uptime\n0,5\n1,6\n", outputs=["uptime"])
    assert asked.output(0).tolist() == [5, 6]


@given(
    st.sampled_from(["s", "ms", "us", "ns"]),
    st.sampled_from(["time", "t", "timestamp"]),
    st.integers(1_000_000_000, 4_000_000_000),
    st.permutations(["{0}", "T", "T ref"]),
)
def test_stamps_since_1970_give_the_same_kpis_in_any_unit_and_order_of_columns(unit, heading, start, order):
    ticks = [start * round(1 / SECONDS[unit]) + round(second / SECONDS[unit]) for second in np.arange(80.0)]
    columns = {"{0}": ticks, "T": LEVEL.tolist(), "T ref": [30] * 80}
    rows = zip(*(columns[name] for name in order), strict=True)
    e = read(",".join(order).format(heading) + "\n" + "".join(",".join(map(repr, r)) + "\n" for r in rows))
    plain = read(table("time", np.arange(80.0)))
    assert np.allclose(e.t, plain.t, atol=1e-6)
    assert e.channels.time_unit == "s"
    assert dict(e.kpis) == pytest.approx(dict(plain.kpis), abs=1e-4)


def test_stamps_since_1970_are_said():
    found = time_of("timestamp", [1760000000000 + 500 * k for k in range(9)])
    assert (found.read, found.unit, found.stamped) == ("ms", "s", True)
    assert np.array_equal(np.diff(found.t), [0.5] * 8)


def test_days_of_a_spreadsheet_are_recognized_by_what_they_make():
    for step in (0.25, 0.5, 60.0, 90.0):
        found = time_of("timestamp", [repr(46300.375 + step * k / 86400) for k in range(30)])
        assert (found.read, found.unit) == ("d", "s")
        assert np.allclose(np.diff(found.t), step, atol=1e-3)
    late = time_of("time", [f"{46300 + 0.25 * k:.2f}" for k in range(30)])  # a long run in seconds
    assert np.allclose(np.diff(late.t), 0.25)


@pytest.mark.parametrize(
    ("heading", "times"),
    [
        (
            "timestamp",
            34519000 + 4000 * np.arange(50),
        ),  # of a flight controller: microseconds since its start
        ("uptime", 120000 + 500 * np.arange(50)),
        ("time", 500_000_000 * np.arange(50)),
        ("time", 12034 + 500 * np.arange(50)),
        ("time", 1000 * np.arange(50)),
    ],
)
def test_a_unit_that_numbers_leave_open_is_asked_for(heading, times):
    with pytest.raises(
        RecordError, match=rf"no unit of time: write it into the heading, as in '{heading} \[ms"
    ):
        read(table(heading, times))
    e = read(table(heading, times), units={"time": "us"})
    assert (e.channels.time_unit, e.duration) == ("us", times[-1] - times[0])
    assert read(table(f"{heading} [ms]", times), time_unit="s").duration * 1000 == times[-1] - times[0]
    assert read(table(heading, times), time_unit="ms").duration == times[-1] - times[0]


def test_a_time_without_a_unit_is_in_seconds_and_this_is_said():
    assert time_of("time", 500 * np.arange(50)).read == "s"
    assert time_of("time", 60 * np.arange(50)).read == "s"
    assert time_of("time [s]", 60 * np.arange(50)).read == ""
    assert time_of("time", [0, 100, 350, 420, 1000, 2300]).unit == "s"  # as people write them down


def test_a_unit_that_cannot_be_right_is_refused():
    with pytest.raises(RecordError, match=r"'time_s' would reach 1.76e\+12 s, thousands of years"):
        read(table("time_s", [1760000000000 + 500 * k for k in range(9)]))


@pytest.mark.parametrize(
    "index",
    [
        pd.date_range("2026-10-05", periods=80, freq="500ms"),
        pd.date_range("2026-10-05", periods=80, freq="500ms", name="Logged"),
        pd.date_range("2026-10-05", periods=80, freq="500ms", tz="Europe/Berlin"),
        pd.timedelta_range(0, periods=80, freq="500ms", name="since"),
        pd.period_range("2026-10-05", periods=80, freq="500ms"),
        pd.Index(1760000000 * 10**9 + 5 * 10**8 * np.arange(80), name="time"),
        pd.Index(1760000000 * 10**9 + 5 * 10**8 * np.arange(80)),
        pd.Index(T, name="elapsed"),
    ],
    ids=lambda index: f"{type(index).__name__} {index.name}",
)
def test_an_index_of_times_is_the_time(index):
    frame = pd.DataFrame({"T": LEVEL, "T ref": 30.0}, index=index)
    same_kpis(read(frame))
    if index.name is not None and not isinstance(index, pd.TimedeltaIndex):
        same_kpis(read(frame.rename_axis("time").to_csv()))


def local(start, zone, form="%Y-%m-%d %H:%M:%S", step=10):
    """Return what a clock in a zone shows every 10 s, from `start` in UTC."""
    stamps = pd.date_range(start, periods=80, freq=f"{step}s", tz="UTC").tz_convert(zone)
    return [stamp.strftime(form) for stamp in stamps]


BERLIN = ("2026-10-25 00:55", "Europe/Berlin")
"""Five minutes before the end of summer time."""


@pytest.mark.parametrize(
    ("times", "about"),
    [
        (local(*BERLIN), {}),
        (local("2026-11-01 05:55", "America/New_York"), {}),
        (local(*BERLIN, "%H:%M:%S"), {}),
        (local(*BERLIN, "%d.%m.%Y %H:%M:%S"), {}),
        (local(*BERLIN, "%d/%m/%Y %H:%M:%S"), {"time_format": "%d/%m/%Y %H:%M:%S"}),
    ],
)
def test_the_hour_that_comes_twice_in_autumn_is_bridged_and_said(times, about):
    found = time_of("time", times, **about)
    assert np.allclose(np.diff(found.t), 10)
    assert found.said == (
        "the clock steps back by an hour at the end of summer time, after line 31: bridged",
    )
    assert read(table("time", times), **about).duration == pytest.approx(790)


def test_the_hour_that_is_missing_in_spring_is_no_gap():
    found = time_of("time", local("2026-03-29 00:55", "Europe/Berlin"))
    assert np.allclose(np.diff(found.t), 10)
    assert "forward by an hour at the beginning of summer time, after line 31" in found.said[0]
    monday = local("2026-03-30 00:55", "Europe/Berlin", "%Y-%m-%d %H:%M:%S")
    gap = [*monday[:30], *(stamp.replace(" 03:", " 04:").replace(" 02:", " 03:") for stamp in monday[30:])]
    assert np.diff(time_of("time", gap).t).max() > 600
    assert time_of("time", gap).said == ()


def test_rows_that_begin_with_the_latest_one_are_read_backwards():
    found = time_of("time", local(*BERLIN)[::-1])
    assert np.allclose(np.diff(found.t), -10)


@pytest.mark.parametrize(
    "times",
    [
        [*local(*BERLIN)[:25], *local(*BERLIN)[36:]],  # and nobody knows how long the gap is
        [
            *local("2026-10-05 12:55", "UTC", "%I:%M:%S")[:28],
            *local("2026-10-05 12:55", "UTC", "%I:%M:%S")[34:],
        ],
    ],
)
def test_a_jump_beside_a_gap_is_refused(times):
    with pytest.raises(
        RecordError, match=r"the clock steps back by about (an hour|half a day), and a gap leaves"
    ):
        time_of("time", times)


@pytest.mark.parametrize("form", ["2026-10-05 10:00:{:02d}", "10:00:{:02d}", "{}"])
def test_a_clock_that_was_set_back_is_refused_if_other_values_have_those_times(form):
    times = [form.format(k if k <= 20 else k - 5) for k in range(50)]
    with pytest.raises(RecordError, match="line 23: the time steps back by 4 s, and other values have those"):
        time_of("time", times)


@pytest.mark.parametrize(
    "rows",
    [
        [*range(30), *range(20, 50)],  # two exports that overlap
        [*range(30, 50), *range(30)],
        [0, 1, 2, 4, 3, 5, 6, 8, 7, 9],
    ],
)
def test_rows_in_another_order_can_be_sorted(rows):
    text = "time,T\n" + "".join(f"2026-10-05 10:00:{k:02d},{k * k}\n" for k in rows)
    e = read(text, allow=("unsorted", "duplicates"))
    assert np.array_equal(e.t, np.arange(max(rows) + 1))
    assert np.array_equal(e.output(0), e.t**2)


def test_rows_of_one_time_that_hold_other_columns_are_put_together():
    text = (
        "time,T,flow\n"
        + "".join(f"{k},{k},\n" for k in range(9))
        + "".join(f"{k},,{k + 1}\n" for k in range(9))
    )
    e = read(text, allow=("unsorted", "duplicates"))
    assert np.array_equal(e.y, np.column_stack([np.arange(9), np.arange(9) + 1]))


@pytest.mark.parametrize(
    "start", ["2026-10-05 11:55", "2026-10-05 12:55", "2026-10-05 23:55", "2026-10-05 00:55"]
)
@pytest.mark.parametrize(
    "form",
    [
        "%I:%M:%S %p",
        "%Y-%m-%d %I:%M:%S %p",
        "%m/%d/%Y %I:%M:%S %p",
        "%d.%m.%Y %I:%M:%S %p",
        "%I:%M:%S",
        "%Y-%m-%d %I:%M:%S",
    ],
)
def test_clocks_of_12_hours_are_read_with_and_without_am_and_pm(form, start):
    found = time_of("time", local(start, "UTC", form))
    assert np.allclose(np.diff(found.t), 10)
    assert "%p" in form or not found.said or "a clock of 12 hours without AM and PM" in found.said[0]


def test_the_spellings_of_am_and_pm_are_alike():
    for times in (("9:30 a.m.", "9:31 a.m."), ("9:30AM", "9:31AM"), ("12:30 pm", "12:31 pm")):
        assert np.array_equal(np.diff(time_of("time", times).t), [60])
    assert time_of("time", ("12:30 am", "12:31 am")).t[0] == 1800


def test_a_day_that_may_be_a_month_is_asked_for():
    with pytest.raises(RecordError, match="'10/05/2026 9:00:00 AM' may begin with the day or the month"):
        time_of("time", ["10/05/2026 9:00:00 AM", "10/06/2026 9:00:00 AM", "10/08/2026 9:00:00 AM"])


def test_a_format_that_is_none_is_refused():
    with pytest.raises(RecordError, match="time_format='%s' is no format of time stamps"):
        time_of("time", ["at 1", "at 2"], time_format="%s")


def test_a_duration_is_the_time_from_the_first_to_the_last_instant():
    e = read(table("time", [1760000000.0 + 0.5 * k for k in range(61)]), from_zero=False)
    assert (e.t[0], e.duration) == (1760000000.0, 30.0)


@pytest.mark.parametrize(
    "form",
    [
        "%d-%b-%y %H:%M:%S",
        "%d-%b-%Y %H:%M:%S.%f",
        "%m/%d/%Y %H:%M:%S",
        "%d/%m/%y %H:%M",
        "%d.%m.%y %H:%M:%S",
        "%m/%d/%Y %I:%M:%S %p",
    ],
)
@pytest.mark.parametrize("start", ["2026-06-05 23:30:00", "2026-10-25 08:59:00"])
def test_dates_with_the_year_last_are_read_if_the_month_is_clear(form, start):
    found = time_of("time", local(start, "UTC", form, step=60))
    assert np.allclose(np.diff(found.t), 60)


def test_the_missing_hour_of_spring_is_seen_in_american_dates():
    times = local("2026-03-08 06:55", "America/New_York", "%m/%d/%Y %I:%M:%S %p")
    found = time_of("time", times)
    assert np.allclose(np.diff(found.t), 10)
    assert "forward by an hour" in found.said[0]


def test_minutes_with_fractions_of_seconds_go_on_after_an_hour():
    times = ["59:58.0", "59:58.5", "59:59.0", "59:59.5", "00:00.0", "00:00.5"]
    assert np.allclose(np.diff(time_of("time", times).t), 0.5)


@pytest.mark.parametrize("times", [("00:00", "00:03", "00:06"), ("0:00", "0:30"), ("23:59", "24:01")])
def test_what_may_be_hours_or_minutes_is_asked_for(times):
    with pytest.raises(RecordError, match="may be hours and minutes, or minutes and seconds"):
        time_of("time", times)


def test_who_wants_seconds_may_have_a_counter_of_milliseconds():
    with pytest.raises(RecordError, match="has steps of 1000 and no unit of time"):
        read(table("time", range(0, 60_000, 1000)), time_unit="s")


@pytest.mark.parametrize("times", [T, 1760000000 + T * 2, [f"{k} days 00:00:00" for k in range(len(T))]])
def test_an_index_without_a_heading_is_the_time(times):
    assert usual_time_columns(sheet_of(table("", times))) == [0]


def test_row_numbers_without_a_heading_are_not_the_time():
    assert usual_time_columns(sheet_of(table("", range(len(T))))) == []
