"""What the benchmark adds to `prefcal calibrate`: simulated people for closed loops, random loops."""

import json

import pytest

from prefcal_scenarios import load


@pytest.mark.usefixtures("small_samples")
def test_a_closed_loop_is_calibrated_by_somebody_with_a_taste(prefcal, done, tmp_path):
    words = ["--calibrator", "weights", "--no-browser", "--n-max", "5", "--simulate", "30"]
    out = done("calibrate", "servo", *words, "--out", "out", "--json")
    assert list(json.loads(out)["best"]) == list(load("servo").space.names)
    assert (tmp_path / "out" / "report.html").exists()
    again = prefcal("calibrate", "servo", *words, "--out", "again", "--json")[1]
    assert json.loads(again)["best"] == json.loads(out)["best"]


def test_a_random_loop_is_calibrated_by_its_name(done):
    words = ["--calibrator", "synthetic", "--cost", "error", "--agent", "random", "--n-max", "2"]
    out = done("calibrate", "loop-3", *words, "--out", "out", "--json")
    assert list(json.loads(out)["best"]) == list(load("loop-3").space.names)
