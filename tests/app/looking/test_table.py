"""Tables of any logger as runs, and what is said of those that are none."""

import numpy as np
import pandas as pd
import pytest

from prefcal_app.looking.look import run_from
from prefcal_env.errors import RecordError
from prefcal_env.tables import TableColumns

pytest.importorskip("pandas")


def read(folder, text, **reading):
    path = folder / "run.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return run_from(path, TableColumns(**reading))


def test_a_plain_table_is_understood_and_this_is_said(tmp_path):
    run = read(tmp_path, "time [min],level [m],level ref,note\n0,1,2,a\n1,2,2,b\n")
    e = run.experiment
    assert (e.channels.time_unit, e.channels.y[0].unit, e.channels.y[0].target) == ("min", "m", 2)
    assert "outputs level; references of level" in run.about
    assert "left out: note" in run.about


def test_semicolons_decimal_commas_gaps_and_repeated_times(tmp_path):
    run = read(tmp_path, "t;level\n3;4,5\n0;1,5\n1;\n2;2,5\n2;3,5\n")
    assert run.experiment.t.tolist() == [0, 1, 2, 3]
    assert run.experiment.output(0).tolist() == [1.5, 2.5, 3.5, 4.5]
    assert "sorted" in run.about
    assert "only the last one is kept (1 left out)" in run.about


def test_rows_without_a_time_and_empty_cells_are_said(tmp_path):
    run = read(tmp_path, "Timestamp,y,v\n0,1,5\n,2,5\n1,,\n2,3,7\n3,,\n", inputs=("v",))
    e = run.experiment
    assert e.t.tolist() == [0, 1, 2]  # all columns end there: the run stopped
    assert e.output(0).tolist() == [1, 2, 3]
    assert e.u[:, 0].tolist() == [5, 5, 7]
    assert "1 of 5 rows have no time and are left out" in run.about
    assert "empty cells filled from their neighbors in y, v" in run.about


def test_a_gap_and_an_early_end_are_said_and_nothing_counts_as_unsafe(tmp_path):
    rows = "".join(f"{t},{t},{'' if t > 40 else 1}\n" for t in (*range(10), *range(40, 45)))
    run = read(tmp_path, "t,y,v\n" + rows)
    assert "a gap of 31 s after 9 s, where 1 s is usual: bridged" in run.about
    assert "no values in the last rows of v" in run.about
    assert not run.experiment.end.interrupted


def test_the_first_column_is_the_time_if_none_is_called_so(tmp_path):
    run = read(tmp_path, ",y\n5,1\n6,2\n")
    assert run.experiment.t.tolist() == [5, 6]
    assert [c.name for c in run.experiment.channels.y] == ["y"]


def test_of_two_hundred_columns_the_first_are_shown(tmp_path):
    head = ",".join(f"c{k}" for k in range(200))
    run = read(tmp_path, f"t,{head}\n" + "\n".join(f"{t}," + ",".join("1" * 200) for t in (0, 1)))
    assert len(run.experiment.channels.y) == 12
    assert "choose others with --outputs" in run.about


LEVEL = [round(2 - 2 * 0.8**k, 4) for k in range(30)]


def test_the_unit_of_the_time_is_said(tmp_path):
    start = 1760000000
    rows = "".join(f"{{{k}}},{level},2\n" for k, level in enumerate(LEVEL))
    for heading, scale, words in (
        ("timestamp", 1000, "time from 'timestamp', read as ms, in s; outputs level; references of level"),
        ("timestamp", 10**9, "time from 'timestamp', read as ns, in s;"),
        ("time_min", 1, "time from 'time_min' in min;"),
        ("time", 1, "time from 'time' in s, as no unit is given;"),
    ):
        first = start if scale > 1 else 0
        times = [str((first + k) * scale) for k in range(30)]
        run = read(tmp_path, f"{heading},level,level ref\n" + rows.format(*times))
        assert run.about.startswith(words)
        assert run.experiment.duration == 29
    run = read(tmp_path, "time,level\n0,1\n500,2\n1000,3\n")
    assert run.about.startswith("time from 'time' in s, as no unit is given;")
    run = read(tmp_path, "time,level\n0,1\n500,2\n1000,3\n", units={"time": "ms", "level": "m"})
    assert (run.experiment.channels.time_unit, run.experiment.channels.y[0].unit) == ("ms", "m")


def test_a_first_column_that_is_no_time_is_refused(tmp_path):
    for text in ("T,power\n20,1\n21,2\n22,1\n", "temperature,power\n20,1\n22,2\n21,1\n"):
        with pytest.raises(RecordError, match=r"no column is called time, and .* may be none: name the"):
            read(tmp_path, text)
    assert read(tmp_path, "T,power\n20,1\n21,2\n22,1\n", time="T").experiment.duration == 2


def test_a_row_for_each_tag_bad_values_and_what_is_left_out_are_said(tmp_path):
    rows = "".join(f"PV,{k},{level if k != 4 else 'Bad Input'}\n" for k, level in enumerate(LEVEL))
    run = read(tmp_path, "tag,time,value\n" + rows + "SP,0,2\nMODE,0,AUTO\n", reference={"PV": "SP"})
    assert "one row for each 'tag': now columns PV, SP; tags without numbers left out: MODE" in run.about
    assert "1 bad value is a gap in PV ('Bad Input')" in run.about
    assert [c.name for c in run.experiment.channels.y] == ["PV"]
    assert run.experiment.channels.y[0].target == 2
    rows = "".join(f"{k},{k},{k},{'Bad' if 3 < k < 6 else 'Good'},\n" for k in range(9))
    run = read(tmp_path, "No.,time,level,quality,uptime\n" + rows.replace(",\n", ",7\n"))
    assert [c.name for c in run.experiment.channels.y] == ["level"]
    for words in (
        "2 bad values are gaps in level (quality Bad)",
        "left out, as they hold row numbers: No.",
        "left out, as they hold another time: uptime",
        "left out, as they hold quality: quality",
    ):
        assert words in run.about


@pytest.mark.extended
def test_parquet_is_read_with_its_index(tmp_path):
    pytest.importorskip("pyarrow", reason="needs pyarrow: pip install pyarrow")
    path = tmp_path / "run.parquet"
    pd.DataFrame({"level [m]": [1.0, 2.0]}, index=pd.Index([0.0, 5.0], name="time")).to_parquet(path)
    assert np.array_equal(run_from(path).experiment.t, [0, 5])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "needs a line of headings and rows of values, got no line"),
        ("time,level\n", "got headings only"),
        ("0,1\n1,2\n", "got the numbers 0, 1: add a line"),
        ("time,who\n0,anna\n", "no column of numbers beside the time"),
        ("time,level\n0,1\n1,2\n2,x\n", "line 4, column 'level': expected a number, got 'x'"),
        ("time,level\n,1\n", "should hold the time but is empty: name another one with --time"),
        ("time,level\nsoon,1\n", "expected a number or a time stamp"),
        ("time,y,y \n0,1,2\n", "column 'y' appears 2 times"),
        (bytes(range(256)) * 3, "neither text nor Parquet"),
    ],
)
def test_a_bad_table_is_refused_with_what_to_do(tmp_path, text, words):
    with pytest.raises(RecordError, match=words):
        read(tmp_path, text)


@pytest.mark.parametrize(
    "reading",
    [
        {"outputs": ("valve",), "reference": {"level": "2"}},
        {"inputs": ("level",), "reference": {"level": "2"}},
    ],
)
def test_the_reference_of_what_is_no_output_is_refused(tmp_path, reading):
    with pytest.raises(RecordError, match=r"'level' has a reference but is .*: the outputs are valv"):
        read(tmp_path, "t,level,valve\n0,1,5\n1,2,6\n", **reading)


@pytest.mark.parametrize(
    "reading",
    [
        {"time": "nix"},
        {"outputs": ("nix",)},
        {"inputs": ("nix",)},
        {"columns": {"a": "nix"}},
        {"reference": {"nix": "2"}},
        {"units": {"nix": "m"}},
        {"reference": {"level": "nix"}},
    ],
)
def test_a_missing_column_is_named_with_those_that_exist(tmp_path, reading):
    with pytest.raises(RecordError, match="no column is called 'nix'; there are 't', 'level'"):
        read(tmp_path, "t,level\n0,1\n1,2\n", **reading)


def test_a_column_may_be_called_like_a_number(tmp_path):
    rows = "".join(f"101,{t},{t}\n102,{t},30\n" for t in range(5))
    run = read(tmp_path, "sensor_id,time,value\n" + rows, reference={"101": "102"})
    assert run.experiment.channels.y[0].target == 30


def test_a_reference_that_begins_late_and_a_run_that_ends_early_are_said(tmp_path):
    rows = "".join(f"{t},{t if t < 20 else ''},{9 if t == 3 else ''},1\n" for t in range(30))
    run = read(tmp_path, "time,y,y ref,v\n" + rows, inputs=("v",))
    assert run.experiment.duration == 19
    assert "y ref is not known before its first value, and nothing is measured there" in run.about
    assert "the run ends where no output has a value any more" in run.about
    assert "no values in the last rows of y ref: the last one is held" in run.about
