"""`--robust`: a study shows what holds on other plants, says so at the end, and resumes."""

import json
import re
from pathlib import Path

import pytest

from prefcal_app import ask
from prefcal_env.errors import ScenarioError
from support import unseen as unseen_module
from support.studies import state_of
from support.unseen import unseen

FUNCTION = f"{unseen_module.__file__}:unseen"
FEW = ["--calibrator", "synthetic", "--cost", "error", "--simulate", "60", "--n-max", "3", "--out", "out"]


def test_a_robust_study_says_how_its_result_holds_and_what_that_costs(done, prefcal):
    code, out, err = prefcal("calibrate", "lag", *FEW, "--robust", "--study", "mine")
    assert code == 0, err
    said = " ".join(out.split())
    kept = "The result holds: all 300 runs with varied plants (not sensors, actuators or task) end safely"
    assert f"{kept} and reach what the nominal run" in said
    assert "(no limit is stated). The varied runs vary time constant of temperature, time" in said
    assert "and the seed of the noise; prefcal verify also varies" in said
    assert "sign of the step. Robustness costs" in said
    assert "Margins of the nominal loop: gain margin [dB]: " in said
    assert "<li>gain margin [dB]: " in Path("out", "report.html").read_text("utf-8")
    sheet = " ".join(Path("out", "acceptance.html").read_text("utf-8").split())
    assert f"<dt>Robust study</dt><dd>{kept}" in sheet
    configuration = state_of("mine").configuration
    assert configuration["options"]["robust"] is True
    words = ["calibrate", "lag", "--study", "mine", "--json", "--out", "out", "--n-max", "4"]
    assert json.loads(done(*words))["experiments"] == 4


def test_where_no_bar_moves_a_robust_study_says_how_far_its_runs_are(monkeypatch, prefcal):
    for name in ("_TELL", "_SOON"):
        monkeypatch.setattr(f"prefcal_app.simulating.simulator.{name}", 0.0)
    code, out, err = prefcal("calibrate", "lag", *FEW, "--robust")
    assert code == 0, err
    lines = [int(done) for done in re.findall(r"^(\d+) of 300 varied runs$", out + err, re.MULTILINE)]
    assert len(lines) >= 5
    assert all(0 < done <= 300 for done in lines)


def test_what_cannot_be_varied_is_refused_with_what_to_add(refused):
    told = refused("calibrate", FUNCTION, "--robust", "--calibrator", "synthetic")
    assert "since it is only a function of θ: give the parameters" in told
    with pytest.raises(ScenarioError, match="only a function"):
        ask(unseen, robust=True)
