import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_app.session import Choice, Phase, actions
from prefcal_app.view import now_view
from prefcal_scenarios.scenario import Scenario
from support.interviews import begin, proceed
from support.looks import SPACE, answer, asked, run, toy


def test_progress_counts_comparisons_which_are_one_fewer_than_experiments():
    interview, _ = asked(Choice.LEFT, Choice.SAME)
    view = now_view(interview)
    progress = {
        "answered": 2,
        "questions": 5,
        "text": "question 3 of 5",
        "given": 2,
        "experiments": 4,
        "n_max": 6,
        "running": 0,
    }
    assert view["progress"] == progress
    assert view["question"]["number"] == 3


def test_before_the_first_experiment_it_runs_and_asks_nothing():
    view = now_view(begin(toy))
    assert (view["phase"], view["question"], view["over"]) == ("running", None, None)
    json.dumps(view, allow_nan=False)


# Each example is looked at after none, one, ... and all of its answers, open and blind: 180 views.
@settings(max_examples=15)
@given(choices=st.lists(st.sampled_from(list(Choice)), min_size=5, max_size=5))
def test_every_moment_of_a_study_is_json_without_nan(choices):
    interview, now = asked()
    for answered in range(len(choices) + 1):
        for blind in (False, True):
            view = json.loads(json.dumps(now_view(interview, blind=blind), allow_nan=False))
            assert view["version"] == now.version
            assert (view["over"] is None) == (now.phase is not Phase.OVER)
        if answered < len(choices):
            now = answer(interview, choices[answered])
    # Contradictions and ties lead to a few further questions about known experiments.
    for _ in range(8):
        if now.phase is Phase.OVER:
            break
        now = answer(interview, Choice.LEFT)
    assert now.phase is Phase.OVER


def test_the_end_shows_the_best_with_theta_to_copy_and_the_commands():
    interview, now = asked(*[Choice.LEFT] * 5)
    view = now_view(interview, again="go on", command="repeat it")
    assert now.phase is Phase.OVER
    best = view["over"]["best"]
    assert best["number"] == now.incumbent + 1
    assert [line.split(" = ")[0] for line in best["copy"].splitlines()] == ["T_s", "N_p", "gain"]
    assert (view["over"]["command"], view["study"]["again"]) == ("repeat it", "go on")
    assert view["over"]["reason"] == "all compared"


def test_good_enough_offers_to_finish_and_blind_does_not_say_which():
    interview, now = asked()
    best = now.incumbent
    side = "left" if now.question.left.index == best else "right"
    assert now_view(interview)["good_enough"] is None
    interview.do(actions.Mark(now.question.id, side, "good enough", True))
    assert now_view(interview)["good_enough"] == {"number": best + 1}
    assert now_view(interview, blind=True)["good_enough"] == {"number": None}


def _broken(theta, seed=0):
    raise RuntimeError("no license")


@pytest.mark.parametrize("blind", [False, True])
def test_a_run_that_raised_is_told_and_blind_hides_its_theta(blind):
    interview = begin(Scenario("broken", "Broken", SPACE, _broken))
    proceed(interview)
    view = now_view(interview, blind=blind)
    assert view["phase"] == "failed"
    assert "no license" in view["problem"]
    assert view["pending"]["number"] == 1
    assert bool(view["pending"]["theta"]) is not blind
    assert bool(view["pending"]["copy"]) is not blind


def test_a_scenario_with_nothing_but_what_it_must_have_can_be_asked_about():
    interview = begin(Scenario("plain", "Plain", SPACE, run))
    proceed(interview)
    view = now_view(interview)["question"]
    titles = [kpi["title"] for kpi in view["left"]["kpis"]]
    assert titles == [
        "settling time of level <h>",
        "overshoot of level <h>",
        "integrated error of level <h>",
        "total move of valve",
    ]
    assert len(view["panels"]) == 2
    silent = begin(Scenario("plain", "Plain", SPACE, run, kpis=()))
    proceed(silent)
    assert now_view(silent)["question"]["left"]["kpis"] == []
