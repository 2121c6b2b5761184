"""Studies of described scenarios: killed, resumed and reported from another folder, exported."""

import json
import shlex
import signal

import pytest

from prefcal_app import load_controller
from prefcal_env.controllers.stored import as_data
from prefcal_env.study import verify
from support.processes import finished, start, wait_until
from support.studies import state_of

COST = "def cost(e):\n    return e.kpis['overshoot'] + e.kpis['total_move']\n"
SCORED = ("--agent", "glis", "--cost", "cost.py:cost")


@pytest.fixture
def plant(prefcal, tmp_path):
    """Write a plant, and a cost, into the working directory."""
    assert prefcal("new", "pid", "plant.py")[0] == 0
    (tmp_path / "cost.py").write_text(COST)
    return tmp_path


@pytest.mark.parametrize("controller", ["pid", "lqr"])
def test_a_study_by_options_alone_is_reported_by_naming_its_plant(prefcal, done, plant, controller):
    words = ["--plant", "plant.py:plant", "--stop-time", "60", *SCORED, "--n-max", "2"]
    done("calibrate", controller, *words, "--study", "a.prefcal", "--out", "out")
    best = json.loads((plant / "out" / "best.json").read_text())
    assert as_data(load_controller(plant / "out" / "best.json")) == best["settings"]
    # A study must not decide which program runs; what is said can be typed as it is.
    code, _, err = prefcal("report", "a.prefcal", "--scenario", controller, "--out", "again")
    assert code == 2
    said = " ".join(err.split()).partition("if you trust it, add ")[2]
    assert said.startswith("--plant")
    trusted = ["report", "a.prefcal", *shlex.split(said), "--cost", "cost.py:cost"]
    done(*trusted, "--out", "again")
    again = json.loads((plant / "again" / "best.json").read_text())
    assert again["theta"] == best["theta"]
    assert again["settings"] == best["settings"]
    assert prefcal("report", "a.prefcal", "--out", "more")[2].endswith(f"add {said}\n")
    assert prefcal(*(word for word in trusted if word != "--scenario"), "--out", "more")[0] == 0


def test_another_limit_than_the_studys_is_refused_with_the_two_ways_to_state_it(done, refused, plant):
    words = ["calibrate", "pid", "--plant", "plant.py:plant", "--stop-time", "60", *SCORED]
    study = ["--study", "a.prefcal"]
    done(
        *words, "--n-max", "2", *study, "--out", "out", "--limit", "overshoot <= 10 %", "--limit", "M_s <= 2"
    )
    said = refused(*words, *study, "--limit", "overshoot <= 5 %")
    assert (
        "keeps the limits with which it was started (overshoot <= 10 %; M_s <= 2), got overshoot <= 5 %"
        in said
    )
    assert "prefcal verify BEST.json --limit 'overshoot <= 5 %'." in said
    assert said.endswith("--taste a.prefcal --limit 'M_s <= 2' --limit 'overshoot <= 5 %'")
    done(
        *words, "--n-max", "3", *study, "--out", "out", "--limit", "overshoot <= 10 %", "--limit", "M_s <= 2"
    )
    own = refused("calibrate", "servo", "--limit", "overshoot <= 5 %")
    assert own.endswith("leave it out; prefcal verify takes it for any result")


def test_a_plant_is_refused_where_there_is_none(prefcal, done, refused):
    words = ["calibrate", "servo", "--calibrator", "synthetic", "--cost", "error"]
    words += ["--agent", "random", "--n-max", "2"]
    done(*words, "--study", "a.prefcal", "--out", "out")
    assert "has no plant of its own: leave --plant out" in refused(
        "report", "a.prefcal", "--plant", "model.py:plant"
    )


def test_a_killed_study_of_a_pid_is_resumed_from_another_folder(plant):
    words = ["calibrate", "pid", "--plant", "plant.py:plant", *SCORED, "--study", "level.prefcal"]
    process = start(plant, *words, "--n-max", "40")
    study = plant / "level.prefcal"
    try:
        wait_until(lambda: study.exists() and study.stat().st_size > 200_000)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert not verify(study)
    kept = state_of(study).finished
    assert 0 < len(kept) < 40
    elsewhere = plant / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "cost.py").write_text(COST)  # a study keeps how its cost was called
    line = "calibrate pid --plant ../plant.py:plant --cost cost.py:cost --study ../level.prefcal"
    code, _, err = finished(elsewhere, *line.split())
    assert code == 0, err
    now = state_of(study)
    assert len(now.finished) == 40
    assert {index: now.finished[index] for index in kept} == kept
