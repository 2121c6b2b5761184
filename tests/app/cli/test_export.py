"""`prefcal export`: what it prints and writes, and what it refuses."""

import ctypes
import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from prefcal_app import load_controller
from prefcal_app.view.end import NOMINAL
from prefcal_env import PID, Measurement
from prefcal_env.controllers import as_data
from prefcal_env.disk import digest_of
from support.verified import FOUND


@pytest.fixture
def best(tmp_path):
    """Write the best.json of a heater."""
    content = {
        "format": 1,
        "scenario": "somewhere/own.py:heater",  # which is not there, and not needed
        "title": "Heater",
        "theta": {"K_p": 2.0},
        "units": {"K_p": "%/°C"},
        "settings": as_data(PID(2.0, 120.0, 10.0, T_s=1.0, low=0.0, high=100.0)),
        "channels": {"time_unit": "s", "x": [], "u": [["valve", "%"]], "y": [["T", "°C"]]},
    }
    (tmp_path / "best.json").write_text(json.dumps(content))
    return "best.json"


def test_structured_text_goes_to_a_file_or_is_printed(prefcal, best, tmp_path):
    code, out, err = prefcal("export", best, "--to", "st", "--name", "Heater")
    assert (code, err) == (0, "")
    assert "FUNCTION_BLOCK Heater\n" in out
    assert prefcal("export", ".", "--to", "st", "--name", "Heater")[1] == out  # the folder names it, too
    code, told, _ = prefcal("export", best, "--to", "st", "--name", "Heater", "--out", "heater.st")
    held = "Not verified on other plants than the modeled one: run prefcal verify best.json."
    assert (code, told.strip()) == (0, f"Written: heater.st. {held}")
    assert (tmp_path / "heater.st").read_text() == out
    assert f"...\n   {held}\n   PID, to be called" in out  # a line of the first comment
    assert prefcal("export", best, "--to", "forms")[1].startswith(f"{held}\n")
    content = json.loads((tmp_path / best).read_text())
    assumed = "Nobody stated limits of valve; 20 to 60 % is assumed."
    (tmp_path / best).write_text(json.dumps(content | {"assumed": [assumed]}))
    margins = "Margins of the nominal loop: M_s: 1.6 (before 1.7)."
    (tmp_path / NOMINAL).write_text('{"margins": ["M_s: 1.6 (before 1.7)"]}')
    for to, between in (("st", "\n   "), ("c", "\n   "), ("forms", " ")):  # a comment has a line for each
        assert between.join((held, margins, assumed)) + "\n" in prefcal("export", best, "--to", to)[1]
    (tmp_path / best).write_text(json.dumps(content | {"assumed": {}}))
    assert "'assumed' in 'best.json' must be a list" in prefcal("export", best, "--to", "c")[2]


@pytest.mark.parametrize(
    ("headline", "said"),
    [
        (
            "Does not hold: 3 of 9 runs keep T ±5 %. Noise alone takes moves from 4 to 26. M_s 2: kept.",
            "Does not hold: 3 of 9 runs keep T +/-5 %.\n   Noise alone takes moves from 4 to 26.\n   "
            "M_s 2: kept.\n   Verified today.",
        ),
        (
            "Of the plant as its files are now, not as in the study. Holds: 9 of 9 runs keep M ≤ 2. More: 2.",
            "Of the plant as its files are now, not as in the study.\n   Holds: 9 of 9 runs keep M <= 2.\n   "
            "More: 2.\n   Verified today.",
        ),
        ("Nothing can be varied.", "Nothing can be varied.\n   Verified today."),
    ],
)
def test_code_says_all_that_the_verdict_says_a_line_each(prefcal, best, tmp_path, headline, said):
    found = replace(FOUND, best=digest_of(tmp_path / best), headline=headline, at="today")
    found.write(tmp_path)
    assert f"\n   {said}\n" in prefcal("export", best, "--to", "c")[1]
    judged = replace(found, worst=(replace(FOUND.worst[0], verdict="not acceptable"),))
    judged.write(tmp_path)
    assert "A person found 1 of the 1 worst runs not acceptable." in prefcal("export", best, "--to", "c")[1]
    (tmp_path / best).write_text((tmp_path / best).read_text() + "\n")
    assert "verification.json is of another best.json" in prefcal("export", best, "--to", "c")[1]


def test_forms_are_in_the_units_and_ranges_of_the_control_system(prefcal, best):
    code, out, _ = prefcal("export", best, "--to", "forms", "--time", "min", "--ranges", "-20:180,0:100")
    assert code == 0
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert {"T_i 2 min", "K 4 %/%", "PB (proportional band) 25 %"} <= set(lines)  # 2 %/°C over 200 °C


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "ladder"], "'ladder' is not one of 'st', 'c', 'forms'"),
        (["--to", "st", "--name", "1st"], "the name of a controller's code must be"),
        (["--to", "forms", "--ranges", "200"], "--ranges must look like 0:200,0:100"),
        (["--to", "forms", "--ranges", "1.2.3:4,0:1"], "--ranges must look like 0:200,0:100"),
        (["--to", "forms", "--ranges", "200:0,0:100"], "low first, then high"),
        (["--to", "forms", "--ranges", "0:200,5:5"], "low first, then high"),
        (["--to", "c", "--out", "nowhere/pid.h"], "--out must be in an existing folder"),
    ],
)
def test_what_cannot_be_written_says_why(prefcal, best, words, said):
    code, out, err = prefcal("export", best, *words)
    assert code != 0
    assert out == ""
    assert said in " ".join(err.split())


ROOM = """
import numpy as np
from prefcal_env import Channel, ClosedLoop, Knob, KnobSpace, LinearMPC, MPCSettings, Plant, PlantEnv, Task
from prefcal_env.controllers import as_data
from prefcal_scenarios import Scenario

heating, temperature = Channel("heating", "kW", 0, 8), Channel("temperature", "K")
matrices = [[-0.5]], [[0.2]], [[1.0]], [[0.0]]
plant = Plant.of(matrices, inputs=heating, outputs=temperature, time_unit="h")
task = Task(x0=plant.x0, u0=plant.u0, y_ref=np.array([2.0]), horizon=6.0)
def mpc(theta):
    return LinearMPC(plant, MPCSettings(0.25, 20, 4, Q_y=[[1.0]], Q_du=[[theta[0]]]))
knobs = KnobSpace([Knob("Q_du", 1e-3, 10, scale="log10")])
loop = ClosedLoop(PlantEnv(plant, task), mpc)
room = Scenario("room", "MPC of a room", knobs, loop, settings=lambda theta: as_data(mpc(theta)))
def cost(e):
    return float(np.abs(e.y - 2).sum())
"""
CALLED = """
#include "room.h"
int step(const double *r, const double *x, const double *acted, double *u);
int step(const double *r, const double *x, const double *acted, double *u)
{
    static room_state state;
    return room(&state, 1, acted, r, x, acted, u);
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_an_mpc_that_was_tuned_moves_in_c_as_the_loaded_one(done, tmp_path):
    (tmp_path / "own.py").write_text(ROOM)
    words = ["--calibrator", "synthetic", "--cost", "own.py:cost", "--n-max", "3", "--out", "tuned"]
    done("calibrate", "own.py:room", *words)
    done("export", "tuned/best.json", "--to", "c", "--name", "room", "--out", "room.h")
    (tmp_path / "room.c").write_text(CALLED)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
    subprocess.run(["cc", *strict, "-shared", "-fPIC", "room.c", "-o", "room.so", "-lm"], check=True)
    r, x, acted, u = np.full(1, 2.0), np.full(1, 1.95), np.full(1, 4.5), np.zeros(1)
    vectors = (ctypes.c_void_p(each.ctypes.data) for each in (r, x, acted, u))
    assert ctypes.CDLL(str(tmp_path / "room.so")).step(*vectors) == 0
    measured = Measurement(t=0.0, x=x, u=acted, d=np.zeros(0), y_ref=r)
    assert u == pytest.approx(load_controller("tuned/best.json").move(measured).u, abs=1e-12)
    assert 0 < u < 8  # between the limits, where all of the QP counts
