"""`prefcal look` as a command."""

import json
import re
import signal

from support.processes import start


def tables(folder):
    for name, top in (("a", 1), ("b", 3)):
        (folder / f"{name}.csv").write_text(f"time,level [m]\n0,0\n1,{top}\n2,2\n")


def done(folder, *words):
    process = start(folder, "look", *words)
    out, errors = process.communicate(timeout=60)
    return process.returncode, out, errors


def test_the_link_comes_on_a_line_of_its_own_and_ctrl_c_ends(tmp_path):
    tables(tmp_path)
    process = start(tmp_path, "look", "a.csv", "b.csv", "--no-browser")
    lines = [process.stdout.readline().strip() for _ in range(3)]
    assert lines[0] == "a.csv: time from 'time' in s; outputs level"
    assert lines[2].startswith("http://127.0.0.1:")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode == 0


def test_json_has_both_and_their_differences_and_names_a_picture(tmp_path):
    tables(tmp_path)
    words = ["--json", "--reference", "level=2", "--out", "pair.png"]
    code, out, _ = done(tmp_path, "a.csv", "b.csv", *words)
    found = json.loads(out)
    assert (code, found["picture"]) == (0, "pair.png")
    assert (tmp_path / "pair.png").read_bytes()[:4] == b"\x89PNG"
    assert [run["rows"] for run in found["runs"]] == [3, 3]
    (row,) = [r for r in found["comparison"] if r["title"] == "overshoot of level"]
    assert (row["left"]["text"], row["right"]["text"], row["difference"]) == ("0", "1", "+1 m")


def test_experiments_of_a_study_are_runs_too(tmp_path):
    tables(tmp_path)
    process = start(tmp_path, "calibrate", "cstr", "--calibrator", "synthetic", "--n-max", "3",
                    "--study", "mine.prefcal", "--out", "report")  # fmt: skip
    assert process.wait(120) == 0
    code, out, _ = done(tmp_path, "mine.prefcal:1", "mine.prefcal:2", "mine.prefcal:best", "--json")
    found = json.loads(out)
    assert code == 0
    names, read = ([run[key] for run in found["runs"]] for key in ("name", "read"))
    assert read[:2] == [f"experiment {k} of study mine.prefcal" for k in (1, 2)]
    assert re.fullmatch("experiment [123] of study mine.prefcal", read[2])
    assert len({*names}) == 3  # the best one is another experiment, or has a number added
    assert "time to steady state t_f" in [row["title"] for row in found["comparison"]]
    code, _, errors = done(tmp_path, "mine.prefcal:9", "a.csv")
    assert code == 2
    assert "has no experiment 9; there are 1, 2, 3" in errors
    code, _, errors = done(tmp_path, "mine.prefcal", "a.csv")
    assert "is a study: say which experiment of it, as mine.prefcal:3" in errors
    code, out, _ = done(tmp_path, "mine.prefcal:3", "a.csv", "--terminal")
    assert code == 0


def test_the_terminal_shows_kpis_and_differences(tmp_path):
    tables(tmp_path)
    code, out, _ = done(tmp_path, "a.csv", "b.csv", "--terminal")
    (row,) = [line for line in out.splitlines() if "highest of level" in line]
    assert code == 0
    assert re.split(" {2,}", row)[1:4] == ["2 m", "3 m", "+1 m"]
