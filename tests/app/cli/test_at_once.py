"""`prefcal calibrate --at-once`, called as a user calls it."""

import json

import pytest

from prefcal_env.study import StudyFile
from support.interviews import clock
from toy_study import TOY

SHORT = ["--calibrator", "synthetic", "--agent", "random", "--json"]


@pytest.mark.usefixtures("own_process")
def test_a_study_runs_two_at_once_and_resumes_with_another_number(prefcal, done):
    words = ["calibrate", TOY, *SHORT, "--study", "a.prefcal"]
    out = done(*words, "--n-max", "5", "--at-once", "2")
    assert json.loads(out)["experiments"] == 5
    out = done(*words, "--n-max", "8", "--at-once", "3")
    assert (json.loads(out)["experiments"], json.loads(out)["questions"]) == (8, 7)
    with StudyFile.open("a.prefcal", clock=clock()) as study:
        assert len({sample.theta for sample in study.state.history.samples}) == 8
