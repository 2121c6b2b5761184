"""`prefcal calibrate`, called as a user calls it, in this process."""

import json

import pytest

from toy_study import TOY

SYNTHETIC = ["--calibrator", "synthetic"]
QUICK = [*SYNTHETIC, "--agent", "random", "--n-max", "5"]


@pytest.mark.usefixtures("figures", "own_process")
def test_a_study_ends_with_a_table_and_the_place_of_the_report(prefcal, tmp_path):
    code, out, err = prefcal("calibrate", TOY, *QUICK)
    assert code == 0
    for words in ("best", "paper", "automated", "T_s [h]", "settling time", "✓"):
        assert words in out
    assert "prefcal-toy-0/report.html" in out
    assert (tmp_path / "prefcal-toy-0" / "report.html").is_file()
    assert "older better" in err
    assert "best θ" in err


def test_json_prints_only_json_on_standard_output(prefcal, tmp_path):
    code, out, _ = prefcal("calibrate", TOY, *QUICK, "--json", "--seed", "3", "--out", "there")
    result = json.loads(out)
    assert code == 0
    assert list(result["best"]) == ["T_s", "N_p", "gain"]
    assert (result["experiments"], result["questions"]) == (5, 4)
    assert result["report"] == "there/report.html"
    assert (result["seed"], result["agent"], result["stopped"]) == (3, "random", False)
    assert sum(result["verdicts"].values()) == 4


@pytest.mark.usefixtures("figures", "own_process")
def test_the_same_seed_gives_the_same_folder_byte_by_byte(prefcal, tmp_path):
    for out in ("a", "b"):
        assert prefcal("calibrate", TOY, *QUICK, "--out", out)[0] == 0
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert files == sorted(p.name for p in (tmp_path / "b").iterdir())
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_the_scenarios_are_listed(done):
    out = done("scenarios")
    assert "cstr" in out
    assert "T_s, N_p, log Q_Δu" in out
    assert "Closed loops: lag, integrating" in out
    assert "own.py:name" in out


def test_the_version_is_printed(prefcal):
    assert prefcal("--version")[1].startswith("prefcal ")
