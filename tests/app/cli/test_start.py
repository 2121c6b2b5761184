"""`prefcal calibrate --start`: the current tuning, or the best of another study, runs first."""

import json

import pytest

from prefcal_app.terminal.showing import knob_called, theta_of
from prefcal_env.errors import SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.study import StudyFile, study_path
from support.studies import state_of
from toy_study import TOY, toy_scenario

SYNTHETIC = ["--calibrator", "synthetic", "--agent", "random", "--n-init", "2"]
PRESENT = "T_s=0.5, N_p=30, gain=0.1"
OTHER = f"""
from dataclasses import replace
from prefcal_scenarios.catalog import load
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.knobs import LinearConstraint
old = load({TOY!r})
grown = replace(old, name="grown", references={{}},
                space=KnobSpace([*old.space, Knob("filter", 1.0, 5.0, "s")]))
metered = replace(old, name="metered", references={{}},
                  space=KnobSpace([Knob("T_s", 900, 5400, "m"), *old.space.knobs[1:]]))
refused = replace(old, name="refused", references={{}},
                  space=KnobSpace(old.space.knobs, [LinearConstraint("short", {{"T_s": 1}}, 0.3)]))
"""


def test_the_first_experiment_is_the_present_tuning(prefcal, done, refused):
    done("calibrate", TOY, *SYNTHETIC, "--n-max", "4", "--start", PRESENT, "--study", "mine")
    assert state_of("mine").history.samples[0].theta == pytest.approx((0.5, 30, 0.1))
    out = done("calibrate", TOY, "--study", "mine", "--n-max", "6", "--start", PRESENT, "--json")
    whole = prefcal("calibrate", TOY, *SYNTHETIC, "--n-max", "6", "--start", PRESENT, "--json")[1]
    assert json.loads(whole)["best"] == json.loads(out)["best"]
    assert "started with --start" in refused(
        "calibrate", TOY, "--study", "mine", "--start", "T_s=1,N_p=5,gain=1"
    )


def test_a_reference_of_the_scenario_is_a_start(done):
    name, theta = next(iter(toy_scenario().references.items()))
    done("calibrate", TOY, *SYNTHETIC, "--n-max", "3", "--study", "mine", "--start", name, "--start", PRESENT)
    assert state_of("mine").history.samples[0].theta == pytest.approx(tuple(theta))


def test_a_knob_is_called_by_the_beginning_of_its_name():
    space = KnobSpace([Knob("T_s", 0.25, 1.5, "h"), Knob("log Q_Δu", -5.0, 3.0)])
    assert theta_of("log_Q=-1,T_s=0.5", space).tolist() == [0.5, -1.0]
    assert knob_called("log Q_Δu", space) == "log Q_Δu"
    alike = KnobSpace([Knob("log q_1", 0, 1), Knob("log q_11", 0, 1), Knob("log r", 0, 1)])
    assert knob_called("log_q_1", alike) == "log q_1"
    for word in ("log", "", "x"):
        with pytest.raises(SettingsError, match="knob must be one of"):
            knob_called(word, alike)


def test_the_result_of_another_study_is_a_start_and_no_tuning_in_use(done, refused, tmp_path):
    done("calibrate", TOY, *SYNTHETIC, "--n-max", "3", "--out", "a")
    best = json.loads((tmp_path / "a" / "best.json").read_text())
    line = ["calibrate", TOY, *SYNTHETIC, "--n-max", "3", "--start"]
    done(*line, "a/best.json", "--start", PRESENT, "--out", "b")
    content = json.loads((tmp_path / "b" / "best.json").read_text())
    assert content["before"]["theta"] == best["theta"]
    assert content["before"]["what"] == "result of a"
    sheet = (tmp_path / "b" / "acceptance.html").read_text("utf-8")
    assert "Whether the result of a was in use is not known." in sheet
    assert "To go back" not in sheet
    assert "c/best.json" in refused(*line, "c/best.json", "--out", "c")


@pytest.fixture
def mine(done):
    """θ that won another study, called mine."""
    words = ["--n-max", "6", "--study", "mine", "--start", "T_s=1.2,N_p=10,gain=2"]
    done("calibrate", TOY, *SYNTHETIC, *words)
    state = state_of("mine")
    return state.history.samples[state.history.incumbent].theta


def test_experiments_of_another_study_begin_a_study_that_needs_its_file_no_more(
    prefcal, done, refused, mine, tmp_path
):
    line = ["calibrate", TOY, *SYNTHETIC, "--start", "mine:best", "--start", "mine:1", "--seed", "5"]
    whole = done(*line, "--n-max", "7", "--study", "whole", "--json")
    done(*line, "--n-max", "3", "--study", "hers", "--out", "a")
    first, second = (state_of("hers").history.samples[k].theta for k in (0, 1))
    assert (first, second) == (pytest.approx(mine), pytest.approx((1.2, 10, 2)))
    assert "--start mine:best" in (tmp_path / "a" / "report.html").read_text()
    study_path("mine").unlink()
    out = done(*line, "--n-max", "7", "--study", "hers", "--json", "--out", "a")
    assert json.loads(out)["best"] == json.loads(whole)["best"]
    told = "started with --start mine:best; mine:1, got --start theirs:best"
    assert told in refused("calibrate", TOY, "--study", "hers", "--start", "theirs:best")


@pytest.mark.parametrize(
    ("scenario", "start", "said"),
    [
        (TOY, "nobody:best", "no study 'nobody'"),
        (TOY, "mine:9", "has no experiment 9; there are 1, 2, 3, 4, 5, 6"),
        (TOY, "empty:best", "has no experiment best; there are none"),
        ("other.py:grown", "mine:best", "study 'mine' has no knobs ['filter']: give every knob"),
        ("other.py:metered", "mine:best", "'T_s' was in 'h' in the earlier study"),
        ("other.py:refused", "mine:best", "the constraints refuse the θ of mine:best"),
    ],
)
def test_an_experiment_that_cannot_begin_is_refused_before_anything_runs(
    refused, mine, tmp_path, scenario, start, said
):
    (tmp_path / "other.py").write_text(OTHER)
    StudyFile.create(study_path("empty"), state_of("mine").configuration, clock=lambda: "now").close()
    assert said in refused("calibrate", scenario, *SYNTHETIC, "--start", start, "--study", "hers")
    assert not study_path("hers").exists()
