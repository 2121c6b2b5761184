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
        {"reference": {"level": "nix"}},
    ],
)
def test_a_missing_column_is_named_with_those_that_exist(tmp_path, reading):
    with pytest.raises(RecordError, match="no column is called 'nix'; there are 't', 'level'"):
        read(tmp_path, "t,level\n0,1\n1,2\n", **reading)
