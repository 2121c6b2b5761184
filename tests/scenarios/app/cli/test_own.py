"""A user's own scenario file, with what goes wrong in such files."""

import json
import subprocess
import sys

import pytest

from prefcal_scenarios.own.own_file import module_at
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
def test_an_own_scenario_is_calibrated(prefcal, own, tmp_path, case):
    (tmp_path / "neighbor.py").write_text(HEAD + "own = t.toy", encoding="utf-8")
    code, _, err = prefcal("calibrate", own(CASES[case]), *QUICK)
    assert code == 0, err
    assert (tmp_path / "res" / "report.html").exists()


@pytest.mark.parametrize("n_max", ["2", "3"])
def test_the_shortest_studies_run(prefcal, own, n_max):
    code, out, err = prefcal(
        "calibrate", own("own = t.toy"), *SYNTHETIC, "--n-max", n_max, "--json"
    )
    assert code == 0, err
    assert json.loads(out)["experiments"] == int(n_max)


def test_a_reference_outside_the_box_is_refused_before_anything_runs(prefcal, own, tmp_path):
    text = "own = replace(t.toy, references={'far': np.array([9.0, 26, 0.5])})"
    code, _, err = prefcal("calibrate", own(text), *QUICK)
    assert code == 2
    assert "reference 'far'" in err
    assert "T_s" in err
    assert not (tmp_path / "res").exists()


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


def test_the_three_lines_of_best_json_work_in_the_folder_of_the_report(prefcal, own, tmp_path):
    assert prefcal("calibrate", own("own = t.toy"), *QUICK)[0] == 0
    lines = "from prefcal_scenarios import load_controller; load_controller('best.json')"
    done = subprocess.run([sys.executable, "-c", lines], cwd=tmp_path / "res", check=False)
    assert done.returncode == 0


@pytest.mark.parametrize(
    ("words", "text", "message"),
    [
        ("own.py", "own = t.toy", "say which scenario in it, own.py:NAME"),
        ("own.py:own", "import nowhere_to_be_found", "cannot load 'own.py'"),
        ("own.py:own", "own = (", "cannot load 'own.py'"),
        (
            "own.py:own",
            "own = replace(t.toy, cost=None, calibrators={})",
            "only people can compare",
        ),
        ("own.py:own", "own = 1 / 0", "'own.py': ZeroDivisionError: division by zero (line 9)"),
        ("own.py:own", "import prefcal_env as e; e.Knob('k', 2, 1)", "(line 9)"),
    ],
)
def test_a_broken_own_file_is_refused_in_one_line(prefcal, own, words, text, message):
    own(text)
    code, _, err = prefcal("calibrate", words, *QUICK)
    assert code == 2
    assert message in err
    assert "Traceback" not in err


def test_a_file_that_was_just_edited_is_read_anew(tmp_path):
    own = tmp_path / "just_edited.py"
    for value in ("1", "2", "3"):  # same length, same second
        own.write_text(f"value = {value}\n", encoding="utf-8")
        assert module_at(own).value == int(value)
    assert list(tmp_path.iterdir()) == [own]
