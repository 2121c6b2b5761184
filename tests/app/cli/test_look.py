"""`prefcal look` as a command."""

import json
import re
import signal

import pytest

from support.processes import start
from toy_study import TOY


@pytest.fixture(autouse=True)
def _tables(tmp_path):
    for name, top in (("a", 1), ("b", 3)):
        (tmp_path / f"{name}.csv").write_text(f"time,level [m]\n0,0\n1,{top}\n2,2\n")


def test_the_link_comes_on_a_line_of_its_own_and_ctrl_c_ends(tmp_path):
    process = start(tmp_path, "look", "a.csv", "b.csv", "--no-browser")
    lines = [process.stdout.readline().strip() for _ in range(3)]
    assert lines[0] == "a.csv: time from 'time' in s, as no unit is given; outputs level"
    assert lines[2].startswith("http://127.0.0.1:")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 0


def test_json_has_both_and_their_differences_and_names_a_picture(done, tmp_path):
    words = ["look", "a.csv", "b.csv", "--reference", "level=2", "--out", "pair.png"]
    found = json.loads(done(*words, "--json"))
    assert found["picture"] == "pair.png"
    assert (tmp_path / "pair.png").read_bytes()[:4] == b"\x89PNG"
    assert [run["rows"] for run in found["runs"]] == [3, 3]
    assert [run["duration"] for run in found["runs"]] == [2, 2]
    (row,) = [r for r in found["comparison"] if r["title"] == "overshoot of level"]
    assert (row["left"]["text"], row["right"]["text"], row["difference"]) == ("0", "1", "+1 m")
    assert done(*words).splitlines()[-1] == "Picture: pair.png"


def test_the_duration_and_the_unit_of_stamps_are_in_the_json(done, tmp_path):
    rows = "".join(f"{1760000000000 + 500 * k},{k}\n" for k in range(61))
    (tmp_path / "stamps.csv").write_text(f"timestamp,level\n{rows}")
    found = json.loads(done("look", "stamps.csv", "stamps.csv", "--json"))["runs"][0]
    assert (found["duration"], found["time_unit"]) == (30, "s")
    assert "time from 'timestamp', read as ms" in found["read"]
    words = ["look", "stamps.csv", "stamps.csv", "--unit", "timestamp=ms", "--json"]
    assert json.loads(done(*words))["runs"][0]["duration"] == 30000


def test_experiments_of_a_study_are_runs_too(done, refused):
    unattended = ["--calibrator", "synthetic", "--agent", "random", "--n-max", "3"]
    done("calibrate", TOY, *unattended, "--study", "mine.prefcal", "--out", "report")
    runs = ["mine.prefcal:1", "mine.prefcal:2", "mine.prefcal:best"]
    found = json.loads(done("look", *runs, "--json"))
    names, read = ([run[key] for run in found["runs"]] for key in ("name", "read"))
    assert read[:2] == [f"experiment {k} of study mine.prefcal" for k in (1, 2)]
    assert re.fullmatch("experiment [123] of study mine.prefcal", read[2])
    assert len({*names}) == 3  # the best one is another experiment, or has a number added
    assert "settling time t_f" in [row["title"] for row in found["comparison"]]
    there = "has no experiment 9; there are 1, 2, 3"
    assert there in refused("look", "mine.prefcal:9", "a.csv")
    told = "is a study: say which experiment of it, as mine.prefcal:3"
    assert told in refused("look", "mine.prefcal", "a.csv")
    done("look", "mine.prefcal:3", "a.csv", "--terminal")


def test_the_terminal_shows_kpis_and_differences(done):
    out = done("look", "a.csv", "b.csv", "--terminal")
    (row,) = [line for line in out.splitlines() if "highest of level" in line]
    assert re.split(" {2,}", row)[1:4] == ["2 m", "3 m", "+1 m"]
