"""A user's own scenario file, with what goes wrong in such files."""

import json

import pytest

from prefcal_scenarios.own import module_at
from toy_study import TOY_FILE

HEAD = f"""
import os, signal
from dataclasses import replace
import sys
sys.path.insert(0, {str(TOY_FILE.parent)!r})
import numpy as np
import toy_scenario as t
from prefcal_scenarios import Scenario
"""
CASES = {
    "infinite": "own = replace(t.toy, cost=lambda e: np.inf, calibrators={})",
    "only_a_cost": "own = replace(t.toy, calibrators={})",
    "beside": "import neighbor\nown = neighbor.own",
}
SYNTHETIC = ["--calibrator", "synthetic"]
QUICK = [*SYNTHETIC, "--agent", "random", "--n-max", "4", "--out", "res"]


@pytest.fixture
def own(tmp_path):
    """Write own.py with the toy scenario, changed."""

    def write(text):
        (tmp_path / "own.py").write_text(HEAD + text, encoding="utf-8")
        return "own.py:own"

    return write


@pytest.mark.usefixtures("own_process")
@pytest.mark.parametrize("case", CASES)
def test_an_own_scenario_is_calibrated(done, own, tmp_path, case):
    (tmp_path / "neighbor.py").write_text(HEAD + "own = t.toy", encoding="utf-8")
    done("calibrate", own(CASES[case]), *QUICK)
    assert (tmp_path / "res" / "report.html").exists()


def test_escape_characters_in_names_do_not_reach_the_terminal(prefcal, own):
    text = r"""
knobs = [replace(k, name=f"\x1b[31m{k.name}") for k in t.toy.space]
kpis = [replace(k, title=f"\x1b[2J{k.title}") for k in t.toy.kpis]
from prefcal_env import KnobSpace
own = replace(t.toy, name="\x1b[31mred", title="\x1b[2Jtoy", space=KnobSpace(knobs), kpis=kpis,
              references={"\x1b[5mpaper": t.toy.references["paper"]})
"""
    code, out, err = prefcal("calibrate", own(text), *QUICK)
    assert code == 0, err
    assert "\x1b[31m" not in out + err
    assert "\x1b[2J" not in out + err
    assert "\x1b[5m" not in out + err


@pytest.mark.usefixtures("own_process")
def test_a_reference_that_does_not_run_is_left_out(prefcal, own, tmp_path):
    text = """
def run(theta, seed=0):
    if theta[0] == 0.31:
        raise RuntimeError("pump stuck")
    return t.run(theta, seed)
own = replace(t.toy, run=run)
"""
    code, _, err = prefcal("calibrate", own(text), *QUICK)
    assert code == 0
    assert "'paper' did not run: RuntimeError: pump stuck" in err
    assert (tmp_path / "res" / "best.json").exists()


COSTS = {
    "lambda e: e.kpis['no']": "prefcal: KeyError: 'no' (in own.py:9: own =",
    "lambda e: None": "prefcal: cost must be a number, got None",
}


@pytest.mark.parametrize("cost", COSTS)
def test_a_cost_that_fails_is_one_line_and_the_report_leaves_it_out(prefcal, own, tmp_path, cost):
    text = f"own = replace(t.toy, calibrators={{}}, cost={cost})"
    code, _, err = prefcal("calibrate", own(text), *QUICK, "--study", "./own.prefcal")
    assert code == (1 if "KeyError" in COSTS[cost] else 2)
    assert COSTS[cost] in err
    assert "Traceback" not in err
    best = json.loads((tmp_path / "res" / "best.json").read_text())
    assert best["cost"] is None
    code, _, err = prefcal("report", "./own.prefcal", "--scenario", "own.py:own", "--out", "later")
    assert code == 0
    assert "prefcal: the report has no costs: " in err


SOME = {
    "lambda e: np.nan if e.theta[1] > 20 else 1.0": "cost must be a number, got nan",
    "lambda e: e.kpis['no'] if e.theta[1] > 20 else 1.0": "KeyError: 'no'",
    "lambda e: None if e.theta[1] > 20 else 1.0": "cost must be a number, got None",
}


@pytest.mark.parametrize("cost", SOME)
@pytest.mark.parametrize("agent", ["random", "glis"])
def test_a_theta_whose_cost_is_unknown_has_failed_and_the_study_goes_on(prefcal, own, tmp_path, cost, agent):
    text = f"own = replace(t.toy, calibrators={{}}, cost={cost})"
    words = ["--agent", agent, *([] if agent == "glis" else ["--calibrator", "synthetic"])]
    code, _, err = prefcal("calibrate", own(text), *words, "--n-max", "6", "--out", "res")
    assert code == 0, err
    assert f"counts as failed, as its cost is unknown: {SOME[cost]}" in err
    best = json.loads((tmp_path / "res" / "best.json").read_text())
    assert (best["cost"], best["theta"]["N_p"] <= 20) == (1.0, True)
    assert SOME[cost] in best["origin"]["failed, as their cost is unknown"]
    report = (tmp_path / "res" / "report.html").read_text(encoding="utf-8")
    assert "failed, as their cost is unknown" in report


@pytest.mark.usefixtures("own_process")
def test_ctrl_c_that_compiled_code_turned_into_another_error_is_still_ctrl_c(prefcal, own):
    text = """
def run(theta, seed=0):
    if theta[0] < 0.8:
        os.kill(os.getppid(), signal.SIGINT)
        raise SystemError("returned a result with an exception set")
    return t.run(theta, seed)
own = replace(t.toy, run=run, references={})
"""
    code, _, err = prefcal("calibrate", own(text), *SYNTHETIC, "--agent", "random", "--n-max", "40")
    assert code == 130
    assert "Interrupted after" in err


def test_a_file_that_was_just_edited_is_read_anew(tmp_path):
    own = tmp_path / "just_edited.py"
    for value in ("1", "2", "3"):  # same length, same second
        own.write_text(f"value = {value}\n", encoding="utf-8")
        assert module_at(own).value == int(value)
    assert list(tmp_path.iterdir()) == [own]


@pytest.mark.usefixtures("own_process")
@pytest.mark.parametrize("changed", ["own.py", "neighbor.py", ""])
def test_a_file_that_changed_between_two_sessions_is_said(prefcal, own, tmp_path, changed):
    (tmp_path / "neighbor.py").write_text(HEAD + "own = t.toy", encoding="utf-8")
    words = [
        "calibrate",
        own(CASES["beside"]),
        *SYNTHETIC,
        "--agent",
        "random",
        "--study",
        "mine",
        "--out",
        "res",
    ]
    assert "have changed" not in prefcal(*words, "--n-max", "3")[2]
    if changed:
        with (tmp_path / changed).open("a") as file:
            file.write("\n# another plant")
    code, _, err = prefcal(*words, "--n-max", "4")
    said = (
        "The files of own.py:own have changed since this study began: its 3 experiments ran with the old ones"
    )
    assert code == 0, err
    assert (said in " ".join(err.split())) is bool(changed)
