"""Tables of logged data: what is read, mended or refused, and the experiment that comes of it."""

import re
import sys
from dataclasses import replace
from inspect import signature

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Channel, Channels, End, Rig, TableColumns, from_frame, recorded, tracking_kpis
from prefcal_env.errors import ExperimentError, MissingExtraError, RecordError, SettingsError
from prefcal_env.experiments.panels import Panel, combined, plots_of
from prefcal_env.tables.frame import extreme_rows

GOOD = "time [s],level [m],valve [%],note\n0,1,5,a\n1,2.5,6,b\n2,3,7,c\n3,4,8,d\n"
USE = {"outputs": ["level"], "inputs": ["valve"]}


def same(e):
    assert np.array_equal(e.t, [0, 1, 2, 3])
    assert np.array_equal(e.y[:, 0], [1, 2.5, 3, 4])
    assert np.array_equal(e.u[:, 0], [5, 6, 7, 8])
    assert (e.channels.y, e.channels.u) == ((Channel("level", "m"),), (Channel("valve", "%"),))


@pytest.mark.parametrize(
    "table",
    [
        GOOD,
        "\ufeff# logged\n\n" + GOOD.replace("\n", "\r\n"),
        "sep=;\n" + GOOD.replace(",", ";"),
        GOOD.replace("note", "µ°").encode("cp1252"),
        GOOD.replace("\n", ",\n"),
        GOOD.replace("time [s]", "time [ms]")
        .replace("\n1,", "\n1000,")
        .replace("\n2,", "\n2000,")
        .replace("\n3,", "\n3000,"),
        GOOD.replace("\n0,", "\n2026-11-23T09:59:59Z,")
        .replace("\n1,", "\n2026-11-23 11:00+0100,")
        .replace("\n2,", "\n2026-11-23T10:00:01Z,")
        .replace("\n3,", "\n2026-11-23T10:00:02.000Z,"),
        GOOD.replace("\n0,", "\n100,")
        .replace("\n1,", "\n101,")
        .replace("\n2,", "\n102,")
        .replace("\n3,", "\n103,"),
    ],
)
def test_spellings_of_the_same_table(table):
    same(from_frame(table, 1.0, time_unit="s", **USE))


@pytest.mark.parametrize("time", ["t", "time"])
def test_rows_that_are_selected_or_joined_keep_their_own_time(time):
    frame = pd.DataFrame({time: [0.0, 0.1, 0.5, 1.0], "level": [1.0, 9.0, 2.0, 3.0]})
    for chosen in (frame[frame.level < 9], pd.concat([frame[:1], frame[2:]])):
        e = from_frame(chosen, 1.0)
        assert np.array_equal(e.t, [0, 0.5, 1])
        assert [channel.name for channel in e.channels.y] == ["level"]


def test_headings_are_mapped_and_the_mapping_can_be_kept():
    table = GOOD.replace("level [m]", "TI-101").replace("valve", "V1")
    log = TableColumns(columns={"level": "TI-101", "valve": "V1"}, inputs="valve", units={"level": "m"})
    same(log.read(table, 1.0))
    assert log.read(table, 1.0) == from_frame(
        table, 1.0, columns=log.columns, inputs=["valve"], units=log.units
    )


def test_headings_that_are_mapped_leave_the_other_columns_as_they_are():
    table = "time [s],TI,SP,flow,note\n0,1,2,5,a\n1,2,2,6,b\n2,2,2,7,c\n"
    e = from_frame(table, 1.0, columns={"level": "TI"})
    assert [channel.name for channel in e.channels.y] == ["level", "SP", "flow"]
    e = from_frame(table, 1.0, columns={"level": "TI", "level ref": "SP"}, inputs=["flow"])
    assert [channel.name for channel in e.channels.y] == ["level"]
    assert e.channels.y[0].target == 2
    assert "integrated error of level" in e.kpis


def test_parquet_without_pyarrow_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match="pip install pyarrow, or use CSV"):
        from_frame(b"PAR1xxxx", 1.0)


def test_a_reference_comes_from_a_column_or_a_number():
    table = GOOD.replace("note", "level ref")
    for letter, value in zip("abcd", "2233", strict=True):
        table = table.replace(f",{letter}\n", f",{value}\n")
    assert np.array_equal(from_frame(table, 1.0, **USE).y_ref[:, 0], [2, 2, 3, 3])
    named = from_frame(GOOD.replace("%", "cm"), 1.0, outputs="level", reference={"level": "valve"})
    np.testing.assert_allclose(named.y_ref[:, 0], [0.05, 0.06, 0.07, 0.08])
    with pytest.raises(RecordError, match="column 'valve' is in %, which cannot be converted to m"):
        from_frame(GOOD, 1.0, outputs="level", reference={"level": "valve"})
    assert from_frame(GOOD, 1.0, reference={"level": 3.0}, **USE).channels.y[0].target == 3.0


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("", "a line of headings and rows of values, got no line"),
        ("\n", "a line of headings and rows of values, got no line"),
        ("absent.csv", "cannot read the table 'absent.csv': No such file"),
        (b"\x00\x01", "neither text nor Parquet"),
        (3, "a table must be a pandas DataFrame, the path"),
        ("0,1\n1,2\n", "the first line must hold headings, got the numbers 0, 1"),
        (GOOD.replace("level", "levle"), "no column is called 'level'; .* mean 'levle'"),
        (GOOD.replace("note", "level [m]"), "column 'level' appears 2 times"),
        (GOOD.replace("time [s]", "x"), "no column is called time: name the right one with --time"),
        (GOOD.replace("1,2.5", "1,x"), "line 3, column 'level': expected a number, got 'x'"),
        (GOOD.replace("1,2.5", "1,2.5 m"), "put the unit into the heading"),
        (GOOD.replace("1,2.5", "1,1.234.567"), "remove the separators of thousands"),
        (GOOD.replace(",", ";").replace("3;4", "3;4,5"), "use decimal points in all columns, or"),
        (GOOD.replace("1,2.5", "1,"), "line 3, column 'level': expected a number, got nothing"),
        (GOOD.replace("1,2.5", ",2.5"), "line 3, column 'time': expected a time, got nothing"),
        (GOOD.replace("1,2.5", "noon,2.5"), "line 3, column 'time': expected a number, got 'noon'"),
        (GOOD.replace("1,2.5", "1,2,5"), "line 3 has 5 cells under 4 headings: a decimal comma"),
        (GOOD + "2.5,1,1,e\n", "line 6: time must increase, got 2.5 s after 3 s"),
        (GOOD + "3,1,1,e\n", r"line 6: time must increase, got 3 s after 3 s.*\('duplicates',\)"),
        (GOOD + "33,1,1,e\n", "line 6: a gap of 30 s after 3 s, where 1 s is usual"),
        (GOOD.replace("[s]", "[ticks]"), "the unit of time 'ticks' cannot be converted"),
        (GOOD.replace("\n0,", "\n11/12/2026 10:00,"), "line 2, column 'time': expected a num"),
    ],
)
def test_what_is_wrong_with_a_table_is_refused_in_words(table, words):
    with pytest.raises(RecordError, match=words):
        from_frame(table, 1.0, time_unit="s", **USE)


ROWS = "0,1.0,40\n1,1.6,30\n2,2.1,20\n"
FORMS = {
    "semicolons": ("time [s],level [m],valve [%]\n" + ROWS).replace(",", ";"),
    "decimal commas": ("time [s];level [m];valve [%]\n" + ROWS.replace(",", ";")).replace(".", ","),
    "tabs": ("time [s],level [m],valve [%]\n" + ROWS).replace(",", "\t"),
    "bars": ("time [s],level [m],valve [%]\n" + ROWS).replace(",", "|"),
    "a hint for spreadsheets": "sep=,\ntime [s],level [m],valve [%]\n" + ROWS,
    "a row of units": "time,level,valve\ns,m,%\n" + ROWS,
    "a quoted row of units": '"time","level","valve"\n"[s]","[m]","[%]"\n' + ROWS,
    "a unit of time in parentheses": "time (s),level [m],valve [%]\n" + ROWS,
    "a byte order mark": "\ufefftime [s],level [m],valve [%]\n" + ROWS,
    "spaces": "time [s],level [m],valve [%]\n".replace(" [", "[").replace(",", "  ")
    + ROWS.replace(",", "   "),
    "spaces and quotes": '"time [s]" "level [m]" "valve [%]"\n' + ROWS.replace(",", " "),
    "old line ends": ("time [s],level [m],valve [%]\n" + ROWS).replace("\n", "\r"),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_a_csv_is_read_alike_from_a_table_and_from_a_rig(form, encoding):
    if form == "a byte order mark" and encoding == "cp1252":
        pytest.skip("has none")
    content = FORMS[form].encode(encoding)
    e = from_frame(content, 1.0, inputs="valve")
    assert [c.label for c in (*e.channels.y, *e.channels.u)] == ["level [m]", "valve [%]"]
    level, valve = Channel("level", "m"), Channel("valve", "%")
    record = Rig(Channels((level,), (valve,), (level,)), (2.0,)).read(content, np.ones(1))
    for made in (e, record):
        assert made.t.tolist() == [0, 1, 2]
        assert made.output(0).tolist() == [1.0, 1.6, 2.1]
        assert made.u[:, 0].tolist() == [40, 30, 20]


def test_a_first_row_of_values_is_no_row_of_units():
    e = from_frame("time,mode,level\n2026-11-23T09:00:00Z,h,1\n2026-11-23T09:00:01Z,s,2\n", 1.0)
    assert e.output(0).tolist() == [1, 2]


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        (("09:00:00", "09:00:01,5", "09:01:00"), [0, 1.5, 60]),
        (("23:59:59", "00:00:00", "00:00:01"), [0, 1, 2]),
        (("2026-10-25T02:59:59+02:00", "2026-10-25T02:00:00+01:00", "2026-10-25T01:00:01Z"), [0, 1, 2]),
        (("23.11.2026 09:00:00", "23.11.2026 09:00:01", "23.11.2026 09:00:02"), [0, 1, 2]),
        (("23.11.2026 09:00:00", "25.11.2026 09:00:00"), [0, 172800]),
        (("23.11.2026", "24.11.2026", "25.11.2026"), [0, 86400, 172800]),
        (("9:30", "9:31", "9:31:30"), [0, 60, 90]),
    ],
)
def test_times_of_day_and_zones_are_understood(times, seconds):
    text = "time;level\n" + "".join(f"{t};1.5\n" for t in times)
    assert from_frame(text, 1.0, allow="gaps").t.tolist() == seconds


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('time,level\n0,"1,5"\n1,"2,5"\n', "decimal commas in all of them with semi"),
        ('time,level,flow\n0,"1,500.5",1\n1,"2,500.5",1\n', "remove the separators of thousands"),
        ("time,level,flow\n0,1,1\n1,Bad,1\n2,3,1\n", "expected a number, got 'Bad'"),
        ("time,level,flow\n0,4 %,1\n1,5 %,1\n", "put the unit into the heading"),
        ("time,level,flow\n0,20°C,1\n1,21°C,1\n", "put the unit into the heading"),
        ("time,level,flow\n0,0.5m,1\n1,0.6m,1\n", "put the unit into the heading"),
        ("time,level\n1.234.567,1\n1.234.568,1\n", "remove the separators of thousands"),
        ("time level flow\n0 1 2\n1 2 3 4\n", "line 3 has 4 cells under 3 headings: of a table"),
        ("time level flow\n0 1 2\n1 2\n2 3 4\n", "line 3 has 2 cells under 3 headings: of a"),
        ("Plant 7\n\ntime,level\n0,1\n", "remove the lines above the headings"),
        ('time,level\n0,"1\n1,2\n', "a quote does not end"),
        ('time,"level\nm"\n0,1\n', "line 1: a quoted heading does not end"),
        ("time,level\n0,1\n1,inf\n2,1\n", "line 3, column 'level': expected a number, got inf"),
    ],
)
def test_what_looks_like_a_number_is_refused_and_never_left_out(text, words):
    with pytest.raises(RecordError, match=words):
        from_frame(text, 1.0)


def test_a_column_of_identifiers_is_left_out():
    e = from_frame("time,level,batch\n0,1,12A\n1,2,12A\n2,3,13B\n", 1.0)
    assert [channel.name for channel in e.channels.y] == ["level"]


def test_arguments_may_be_named_and_none_means_that_nothing_is_said():
    named = from_frame(table=GOOD, theta=[1.0], **USE)
    assert named == from_frame(GOOD, theta=[1.0], **USE)
    assert list(signature(from_frame).parameters)[:3] == ["table", "theta", "columns"]
    nothing = dict.fromkeys(("columns", "signals", "reference", "units", "limits", "bands", "allow"), None)
    assert from_frame(GOOD, [1.0], **nothing, **USE) == named


def test_rows_of_a_frame_are_counted_from_zero_when_refused():
    frame = pd.DataFrame({"time": [0, 1, 2], "level": [1, None, 2]})
    with pytest.raises(RecordError, match="row 1, column 'level': expected a number, got nothing"):
        from_frame(frame, 1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"units": {"level": "K"}}, "column 'level' is in m by its heading, but units= says K"),
        ({"units": {"levle": "m"}}, "units names 'levle', which is none of .'level', 'valve'"),
        ({"allow": "repair"}, "allow must hold some of"),
        ({"max_rows": 5}, "max_rows must be 100 or more"),
        ({"signals": ["level", "level"]}, "signals must name each once, got 'level' twice"),
        ({"resample": "often"}, "resample must be a period above 0 s"),
        ({"reference": {"flow": 1.0}}, "reference names 'flow'"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(change, words):
    with pytest.raises((SettingsError, RecordError), match=words):
        from_frame(GOOD, 1.0, **USE, **change)


def test_flaws_that_are_allowed_are_mended():
    def read(table, word):
        return from_frame(table, 1.0, allow=word, **USE)

    assert np.array_equal(read(GOOD + "2.5,9,1,e\n", "unsorted").y[:, 0], [1, 2.5, 3, 9, 4])
    assert np.array_equal(read(GOOD + "3,9,1,e\n", "duplicates").y[:, 0], [1, 2.5, 3, 9])
    bridged = read(GOOD.replace("1,2.5,6", "1,,"), "missing")
    assert (bridged.y[1, 0], bridged.u[1, 0]) == (2.0, 5.0)
    assert read(GOOD + "33,1,1,e\n", "gaps").duration == 33.0


def test_resampling_interpolates_outputs_and_holds_inputs():
    e = from_frame(GOOD, 1.0, resample="500ms", **USE)
    assert np.allclose(e.t, np.arange(0, 3.1, 0.5))
    assert np.allclose(e.y[:4, 0], [1, 1.75, 2.5, 2.75])
    assert np.array_equal(e.u[:4, 0], [5, 5, 6, 6])


def test_a_million_rows_are_read_and_thinned_to_their_extremes():
    values = np.random.default_rng(0).normal(size=1_000_000)
    e = from_frame(pd.DataFrame({"time": np.arange(1e6) / 8, "level": values}), 1.0)
    assert 50_000 < len(e.t) <= 100_000
    assert (e.y.max(), e.y.min(), e.duration) == (values.max(), values.min(), 999_999 / 8)


def test_kpis_are_those_of_all_rows_even_if_only_some_are_kept():
    level = 1 + np.random.default_rng(0).normal(size=5_000)
    table = pd.DataFrame({"time": np.arange(5e3) / 8, "level": level})
    thinned, whole = (from_frame(table, 1.0, reference={"level": 1.0}, max_rows=rows) for rows in (500, None))
    assert len(thinned.t) <= 500
    assert thinned.kpis == whole.kpis


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), min_size=2, max_size=20))
def test_what_goes_out_as_a_frame_comes_back(rows):
    y, u = np.array(rows).T
    e = recorded(
        [1.0], np.arange(len(y)) / 8, {"level": y}, {"valve": u}, {"level": 1.0}, {"level": "m", "valve": "%"}
    )
    assert from_frame(e.to_frame(), [1.0], reference={"level": 1.0}, **USE) == e


def test_an_experiment_shows_itself_in_a_notebook():
    e = from_frame(GOOD, 1.0, reference={"level": 2.0}, **USE)
    shown = e._repr_html_()
    assert "overshoot of level" in shown
    assert "data:image/png;base64," in shown
    nothing = recorded(1.0, [0.0, 1.0], {"a": [np.nan, np.nan]})
    assert "failed" in nothing._repr_html_()
    assert "img" not in nothing._repr_html_()


def test_kpis_in_a_notebook_have_the_units_that_the_channels_tell():
    e = from_frame(GOOD, 1.0, reference={"level": 2.0}, **USE)
    cells = dict(re.findall(r"<td>([^<]+)</td><td[^>]*>([^<]+)</td>", e._repr_html_()))
    assert {name: text.partition(" ")[2] for name, text in cells.items()} == {
        "integrated error of level": "m s",
        "late error of level": "m s²",
        "settling time of level": "s",
        "overshoot of level": "m",
        "final error of level": "m",
        "total move of valve": "%",
        "largest move of valve": "%",
        "RMS move of valve": "%",
    }
    both = combined([replace(e, maneuver="up"), replace(e, maneuver="down")])
    both = both.with_kpis({**both.kpis, "grade": 1.0})
    shown = both._repr_html_()
    assert "<td>overshoot of level (up)</td><td style='text-align:right'>2 m</td>" in shown
    assert "<td>grade</td><td style='text-align:right'>1</td>" in shown


def test_a_rig_reads_frames_files_and_other_headings(tmp_path):
    level, valve = Channel("level", "m"), Channel("valve", "%")
    rig = Rig(Channels((level,), (valve,), (), "s"), (), headings={"level": "TI-101"})
    text = "time [s],TI-101 [m],valve [%]\n0,1,5\n1,2,6\n2,3,7\n"
    (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    frame = pd.read_csv(tmp_path / "run.csv")
    theta = np.ones(1)
    e = rig.read(text, theta)
    assert np.array_equal(e.x[:, 0], [1, 2, 3])
    for source in (tmp_path / "run.csv", str(tmp_path / "run.csv"), frame):
        assert rig.read(source, theta) == e
    with pytest.raises(RecordError, match="column 'TI-101' is missing"):
        rig.read(text.replace("TI-101", "level"), theta)
    with pytest.raises(RecordError, match="a table must be a pandas"):
        rig.read(3, theta)
    with pytest.raises(SettingsError, match="headings must name some of"):
        Rig(rig.channels, (), headings={"flow": "F"})


def test_a_table_of_very_many_columns_is_refused():
    headings = ["time [s]", *(f"c{k}" for k in range(2_000))]
    text = ",".join(headings) + "\n" + "\n".join(",".join("1" * 2_001) for _ in range(2))
    with pytest.raises(RecordError, match="may have 2,000 columns, got 2,001"):
        TableColumns(outputs=["c1"]).read(text, [0.0])


def test_rows_of_many_columns_are_left_out_all_over_the_run():
    columns = list(np.random.default_rng(0).normal(size=(300, 5_000)))
    rows = extreme_rows(columns, 100)
    assert len(rows) == 100
    assert (rows[0], rows[-1]) == (0, 4_999)
    assert np.diff(rows).max() < 500


T = np.linspace(0.0, 10.0, 11)
THETA = [1.0, 2.0]


def test_time_and_outputs_are_enough():
    e = recorded(THETA, T, {"level": T})
    assert (e.x.shape, e.u.shape, e.y.shape) == ((11, 0), (11, 0), (11, 1))
    assert np.array_equal(e.output(0), T)
    assert (e.end, e.duration, e.channels.time_unit) == (End.TIME_UP, 10.0, "s")
    assert np.isnan(e.y_ref).all()
    assert dict(e.kpis) == {}


def test_units_limits_bands_and_references_reach_the_channels_and_the_kpis():
    e = recorded(
        THETA,
        T,
        {"level": np.minimum(T, 3.0)},
        {"valve": T},
        {"level": 2.0},
        {"level": "m", "valve": "%"},
        {"valve": (0, None)},
        bands={"level": 0.5},
        time_unit="min",
    )
    assert e.channels.y == (Channel("level", "m", target=2.0, band=0.5),)
    assert e.channels.u == (Channel("valve", "%", low=0.0),)
    assert e.channels.time_unit == "min"
    assert dict(e.kpis) == tracking_kpis(e)
    assert e.kpis["overshoot of level"] == 1.0
    assert e.kpis["total move of valve"] == 10.0


def test_curves_of_several_time_bases_meet_at_the_union_of_their_instants():
    e = recorded(
        1.0,
        None,
        {"level": (T, 2 * T), "flow": ([0.5, 4.5, 8.0], [0.0, 4.0, 4.0])},
        {"valve": ([0.0, 4.0], [1.0, 3.0])},
    )
    assert np.array_equal(e.t, [0.5, 1, 2, 3, 4, 4.5, 5, 6, 7, 8])
    assert np.allclose(e.output(0), 2 * e.t)
    assert np.allclose(e.output(1), np.minimum(e.t - 0.5, 4.0))
    assert np.array_equal(e.u[:, 0], [1, 1, 1, 1, 3, 3, 3, 3, 3, 3])


def test_curves_of_their_own_are_brought_to_the_given_instants():
    e = recorded(1.0, T, {"level": ([-1.0, 11.0], [-1.0, 11.0])}, {"valve": ([0, 2.5], [5, 6])})
    assert np.allclose(e.output(0), T)
    assert np.array_equal(e.u[:, 0], [5, 5, 5, *[6] * 8])


def test_moves_do_not_depend_on_how_densely_outputs_are_logged():
    steps, u = np.arange(0.0, 10.0, 2.0), [0.0, 1.0, 1.0, 4.0, 2.0]
    kpis = []
    for count in (101, 1001):
        t = np.linspace(0.0, 10.0, count)
        e = recorded(1.0, t, {"level": t}, {"valve": (steps, u)})
        assert np.allclose(e.t_control, steps)
        kpis.append(dict(e.kpis))
    assert kpis[0] == kpis[1]
    assert kpis[0]["total move of valve"] == 6.0
    assert kpis[0]["RMS move of valve"] == pytest.approx(np.sqrt((1 + 0 + 9 + 4) / 4))


def test_inputs_logged_with_the_outputs_count_as_decided_at_every_instant():
    e = recorded(1.0, T, {"level": T}, {"valve": np.where(T < 5, 0.0, 1.0)})
    assert np.array_equal(e.t_control, T)


def test_a_reference_that_changes_is_drawn_and_counts():
    e = recorded(1.0, T, {"level": T}, None, {"level": ([0.0, 5.0], [0.0, 5.0])})
    assert e.channels.y[0].target is None
    assert np.array_equal(e.y_ref[:, 0], np.where(T < 5, 0.0, 5.0))
    assert e.kpis["integrated error of level"] == 2 * 5**2 / 2  # two triangles, the first up to the change
    (plot, *_) = plots_of(e.channels, e.signals)
    assert (plot.name, plot.reference) == ("level", "level ref")
    assert Panel("level").plot(e).reference == "level ref"
    assert Panel("level", "y").plot(e).reference == "level ref"


def test_outputs_are_drawn_above_inputs_if_there_are_no_states():
    e = recorded(1.0, T, {"level": T}, {"valve": T}, signals={"note": T})
    assert [p.name for p in plots_of(e.channels)] == ["level", "valve"]


def test_a_run_that_stopped_ends_with_its_last_finite_row_and_is_unsafe():
    y, u = np.where(T < 7, T, np.nan), np.where(T < 8, T, np.inf)
    e = recorded(1.0, T, {"level": y, "flow": T}, {"valve": u}, {"level": T}, signals={"note": T})
    assert (e.duration, len(e.t), e.end) == (6.0, 7, End.UNSAFE)
    assert np.array_equal(e.signals["note"], T[:7])
    assert recorded(1.0, T, {"level": y}, end=End.TIME_UP).end is End.TIME_UP
    own = recorded(1.0, None, {"level": (T, y), "flow": (T + 0.5, T)})
    assert (own.t[-1], own.duration, own.end) == (6.0, 5.5, End.UNSAFE)


@pytest.mark.parametrize("t", [T, []])
def test_a_run_that_left_nothing_is_failed(t):
    e = recorded(1.0, t, {"level": np.full(len(t), np.nan)}, {"valve": np.ones(len(t))})
    assert (len(e.t), e.end, dict(e.kpis)) == (0, End.FAILED, {})


def test_signals_may_have_gaps():
    e = recorded(1.0, T, {"level": T}, signals={"note": np.full(11, np.nan), "late": ([5, 6], T[:2])})
    assert np.isnan(e.signals["note"]).all()
    assert np.array_equal(np.isfinite(e.signals["late"]), (T >= 5) & (T <= 6))


def test_own_kpis_take_the_place_of_generic_ones():
    assert dict(recorded(1.0, T, {"y": T}, kpis=lambda e: {"peak": e.y.max()}).kpis) == {"peak": 10}
    assert dict(recorded(1.0, T, {"y": T}, {"u": T}, kpis=None).kpis) == {}


def test_columns_and_rows_as_simulators_return_them_are_curves():
    e = recorded(np.ones(1), T.tolist(), {"a": T[:, None], "b": T[None], "c": np.arange(11)})
    assert all(np.array_equal(e.output(j), T) for j in range(3))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"outputs": {}}, "outputs must hold one curve or more"),
        ({"outputs": [T]}, "outputs must be a mapping from names to curves"),
        ({"outputs": {1: T}}, "the name of an output must be text, got 1"),
        ({"outputs": {"level": T[:5]}}, r"output 'level' must have shape \(11,\), as t, got \(5,\)"),
        ({"outputs": {"level": np.ones((11, 2))}}, r"'level' must have shape \(K,\), got \(11, 2\)"),
        ({"outputs": {"level": ["x"] * 11}}, "output 'level' must be numbers, got <U1"),
        ({"outputs": {"level": [1j] * 11}}, "output 'level' must be numbers, got complex128"),
        ({"outputs": {"level": (T, T[1:])}}, r"shape \(11,\), as its times, got \(10,\)"),
        ({"outputs": {"level": (T[2:], T[2:])}}, "'level' is recorded from 2 to 10 s, but t goes"),
        ({"outputs": {"level": (T[:-2], T[2:])}}, "'level' is recorded from 0 to 8 s, but t goes"),
        ({"outputs": {"level": (T[::-1], T)}}, r"times of output 'level' must increase.*\[1\] = 9"),
        (
            {"outputs": {"level": np.where(T == 4, np.nan, T)}},
            r"output 'level' is nan at index 4 \(t = 4 s\), but 5 at index 5",
        ),
        ({"outputs": {"a": T, "b": np.full(11, np.nan)}}, "output 'b' begins with a value that"),
        ({"inputs": {"level": T}}, r"different names, got \['level'\] more than once"),
        ({"inputs": {"valve": (T[3:], T[3:])}}, "input 'valve' is recorded from 3 to 10 s"),
        ({"reference": {"levle": 2.0}}, "reference names 'levle'; .* Did you mean 'level'"),
        ({"reference": 2.0}, "reference must be a mapping by name"),
        ({"reference": {"level": (T[3:], T[3:])}}, "reference of 'level' is recorded from 3"),
        ({"reference": {"level": np.inf}}, "reference of 'level' must be finite"),
        ({"reference": {"level": "two"}}, "reference of 'level' must be numbers"),
        ({"units": {"speed": "%"}}, "units names 'speed'; there are 'level'"),
        ({"limits": {"level": 3.0}}, r"limits of 'level' must be \(low, high\)"),
        ({"limits": {"level": (2.0, 1.0)}}, "'level': low must be below high"),
        ({"bands": {"valve": 1.0}}, "bands names 'valve'"),
        ({"t": T[::-1]}, r"t must increase, but t\[1\] = 9 s comes after 10 s"),
        ({"t": [0, 1, 1, *T[3:]]}, r"t\[2\] = 1 s comes after 1 s"),
        ({"t": np.where(T == 3, np.nan, T)}, r"t\[3\] is nan"),
        ({"t": np.arange(11).astype("M8[s]")}, "use prefcal_env.from_frame for time stamps"),
        ({"t": None}, "output 'level' needs instants: give t"),
        ({"theta": "x"}, "theta must be numbers"),
        ({"theta": []}, "theta must have shape"),
    ],
)
def test_curves_that_do_not_fit_are_refused_by_name_and_place(change, words):
    given = {"theta": THETA, "t": T, "outputs": {"level": T}} | change
    with pytest.raises(ExperimentError, match=words):
        recorded(**given)


def test_curves_without_a_common_time_are_refused():
    with pytest.raises(ExperimentError, match="output 'a' ends at 1 s, before output 'b' begins at 2"):
        recorded(1.0, None, {"a": ([0, 1], [0, 1]), "b": ([2, 3], [0, 1])})


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30),
    st.integers(0, 30),
    st.sampled_from([np.nan, np.inf, -np.inf]),
)
def test_what_precedes_the_end_is_kept_exactly(values, cut, nothing):
    t, y = np.arange(len(values)) / 8, np.array(values)
    y[cut:] = nothing
    kept = min(cut, len(values))
    e = recorded(1.0, t, {"level": y}, kpis=None)
    assert np.array_equal(e.y[:, 0], values[:kept])
    assert e.end is (End.TIME_UP if kept == len(values) else End.UNSAFE if kept else End.FAILED)
