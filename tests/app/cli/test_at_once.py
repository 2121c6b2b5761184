"""`prefcal calibrate --at-once`, called as a user calls it."""

import json

import pytest

from prefcal_env.study import StudyFile
from support.interviews import clock
from toy_study import TOY

SHORT = ["--calibrator", "synthetic", "--agent", "random", "--json"]


@pytest.mark.usefixtures("own_process")
def test_a_study_runs_two_at_once_and_resumes_with_another_number(prefcal):
    words = ["calibrate", TOY, *SHORT, "--study", "a.prefcal"]
    code, out, err = prefcal(*words, "--n-max", "5", "--at-once", "2")
    assert code == 0, err
    assert json.loads(out)["experiments"] == 5
    code, out, err = prefcal(*words, "--n-max", "8", "--at-once", "3")
    assert code == 0, err
    assert (json.loads(out)["experiments"], json.loads(out)["questions"]) == (8, 7)
    with StudyFile.open("a.prefcal", clock=clock()) as study:
        assert len({sample.theta for sample in study.state.history.samples}) == 8


def test_the_order_of_the_runs_does_not_change_which_theta_are_tried(prefcal):
    found = []
    for at_once in ("1", "3"):
        name = f"{at_once}.prefcal"
        prefcal("calibrate", TOY, *SHORT, "--n-max", "6", "--study", name, "--at-once", at_once)
        with StudyFile.open(name, clock=clock()) as study:
            found.append({sample.theta for sample in study.state.history.samples})
    assert found[0] == found[1]


def test_an_agent_that_simulates_on_all_cores_runs_one_at_a_time(prefcal):
    words = ["--calibrator", "weights", "--agent", "screening", "--n-max", "3", "--at-once", "2"]
    code, _, err = prefcal("calibrate", "lag", *words)
    assert code != 0
    assert "leave --at-once out, or choose --agent glisp" in " ".join(err.split())
