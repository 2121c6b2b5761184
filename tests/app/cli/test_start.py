"""`prefcal calibrate --start`: the current tuning as the first experiment."""

import json
import shlex

import pytest

from prefcal_app.terminal.lines import knob_called, theta_of
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from support.studies import state_of
from toy_study import TOY, toy_scenario

SYNTHETIC = ["--calibrator", "synthetic", "--agent", "random", "--n-init", "2"]
PRESENT = "T_s=0.5, N_p=30, gain=0.1"


def test_the_first_experiment_is_the_present_tuning(prefcal, done, refused):
    done("calibrate", TOY, *SYNTHETIC, "--n-max", "4", "--start", PRESENT, "--study", "mine")
    assert state_of("mine").history.samples[0].theta == pytest.approx((0.5, 30, 0.1))
    out = done("calibrate", TOY, "--study", "mine", "--n-max", "6", "--start", PRESENT, "--json")
    whole = prefcal("calibrate", TOY, *SYNTHETIC, "--n-max", "6", "--start", PRESENT, "--json")[1]
    assert json.loads(whole)["best"] == json.loads(out)["best"]
    assert "started with --start" in refused(
        "calibrate", TOY, "--study", "mine", "--start", "T_s=1,N_p=5,gain=1"
    )


def test_the_one_line_of_the_report_repeats_it(prefcal, tmp_path):
    prefcal("calibrate", TOY, *SYNTHETIC, "--n-max", "3", "--start", PRESENT, "--out", "a")
    page = (tmp_path / "a" / "report.html").read_text()
    assert f"--start {shlex.quote(PRESENT)}".replace("'", "&#x27;") in page.replace("&#39;", "&#x27;")


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
