import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents import GLISp
from prefcal_agents.baselines import LatinHypercube
from prefcal_agents.glisp.agent import Foresight
from prefcal_app.session import Choice, Consistency, actions
from prefcal_app.view import status_view
from prefcal_app.view.now import in_words
from prefcal_scenarios.scenario import KPI
from support.interviews import answer_all, begin, proceed
from support.looks import SPACE, THETA, asked, toy


def test_before_anything_is_answered_nothing_is_learned():
    view = status_view(begin(toy))  # before the first experiment
    assert (view["best"], view["slices"], view["tried"]["experiments"]) == (None, None, [])
    interview, _ = asked()
    view = status_view(interview)
    assert view["consistency"]["can_repeat"] is False
    assert view["slices"] is None
    assert [e["number"] for e in view["tried"]["experiments"]] == [1, 2]


def test_slices_run_through_the_best_over_the_whole_range_of_each_knob():
    interview, now = asked(Choice.LEFT, Choice.RIGHT, Choice.LEFT)
    view = status_view(interview)
    json.dumps(view, allow_nan=False)
    best = interview.past.experiment(now.incumbent).theta
    assert [s["best"] for s in view["slices"]] == best.tolist()
    for part, knob in zip(view["slices"], SPACE, strict=True):
        assert (part["x"][0], part["x"][-1]) == pytest.approx((knob.low, knob.high))
        assert np.all(np.diff(part["x"]) > 0)
        assert len(part["x"]) == len(part["y"])
        assert len(part["samples"]["x"]) == len(now.state.finished)


def test_the_samples_of_a_slice_lie_at_their_own_learned_cost():
    interview, now = asked(Choice.LEFT, Choice.RIGHT, Choice.LEFT)
    assert interview.known.surrogate is not None
    tried = np.array([interview.past.experiment(i).theta for i in sorted(now.state.finished)])
    cost = interview.known.surrogate(tried)
    for k, part in enumerate(status_view(interview)["slices"]):
        assert part["samples"]["x"] == tried[:, k].tolist()
        y = np.array(part["samples"]["y"])
        assert np.all(y >= 0)
        assert min(part["y"]) >= 0
        np.testing.assert_allclose(np.diff(y**2), np.diff(cost), atol=1e-9)
    drawn = [[*part["y"], *part["samples"]["y"]] for part in status_view(interview)["slices"]]
    assert min(map(min, drawn)) == 0


@pytest.mark.parametrize(
    ("consistency", "words"),
    [
        (
            Consistency(0, 0, ()),
            "No question has been asked twice yet. The answers do not contradict each other.",
        ),
        (
            Consistency(3, 2, ()),
            "2 of 3 repeated questions got the same answer. The answers do not contradict each other.",
        ),
        (
            Consistency(0, 0, ((0, 4, 2),)),
            "No question has been asked twice yet. Preferred in a circle: 1 over 5 over 3.",
        ),
    ],
)
def test_consistency_in_words(consistency, words):
    assert in_words(consistency) == words


def test_how_well_kpis_explain_the_answers_is_said_once_they_tell():
    interview = begin(toy, n_max=20, agent=LatinHypercube)
    assert status_view(interview)["trust"] == ""
    answer_all(interview, lambda number: None)
    assert "of 19 answers that it had not learned from" in status_view(interview)["trust"]


HARD = replace(toy, kpis=(KPI("t_f", "settling time", "h", at_most=1e-6), *toy.kpis[1:]))


def test_a_missed_objective_is_said_once_enough_is_answered():
    interview, answered = begin(HARD, n_max=9), 0
    while (now := proceed(interview)).question is not None:
        if answered < 5:
            assert status_view(interview)["outlook"] is None
        interview.do(actions.Answer(now.question.id, Choice.SAME))
        answered += 1
    assert "settling time" in interview.known.missed
    outlook = status_view(interview)["outlook"]
    assert outlook["sentences"][0].startswith("The best experiment misses the objective")
    json.dumps(outlook)


def test_where_a_reference_misses_no_objective_the_outlook_names_it():
    interview = begin(HARD, n_max=9)
    answer_all(interview, lambda number: None)
    reference = toy.run(np.array([0.5, 21.0, 1.0]))
    interview.known.references = {"paper": reference.with_kpis({**reference.kpis, "t_f": 0.0})}
    assert "settling time: paper misses none: to begin with it" in interview.known.outlook.missed


def test_where_what_the_person_prefers_misses_an_objective_a_shown_one_that_does_not_is_named():
    interview = begin(replace(toy, kpis=(replace(HARD.kpis[0], at_most=10.0),)), n_max=9)
    met = {}
    while (now := proceed(interview)).question is not None:
        left, right = now.question.left, now.question.right
        met |= {side.index: side.experiment.kpis["t_f"] <= 10.0 for side in (left, right)}
        slower = left.experiment.kpis["t_f"] > right.experiment.kpis["t_f"]
        interview.do(actions.Answer(now.question.id, Choice.LEFT if slower else Choice.RIGHT))
    first = min(index for index, kept in met.items() if kept)
    assert first == 0
    assert "settling time: experiment 1, where the study began, misses none" in interview.known.outlook.missed


@pytest.mark.parametrize(("limit", "stated"), [(np.inf, False), (2.0, True)])
def test_a_loop_that_is_not_stable_is_called_so_and_misses_only_what_is_stated(limit, stated):
    margin = KPI("M_s", "M_s", better="lower", at_most=limit, margin=True)

    def swing(theta, seed=0):
        made = toy.run(theta)
        return made.with_kpis({**made.kpis, "M_s": np.inf})

    interview = begin(replace(toy, kpis=(margin,), run=swing), n_max=9)
    answer_all(interview, lambda number: None)
    assert interview.known.unstable
    assert interview.known.missed == (["M_s"] if stated else [])
    first, *_ = status_view(interview)["outlook"]["sentences"]
    assert first.startswith("The loop of the best experiment is not stable.")
    assert ("misses the objective for M_s" in first) is stated
    assert "finite" not in first


def test_with_nothing_to_say_there_is_no_outlook(monkeypatch):
    interview, _ = asked(*[Choice.LEFT] * 5)
    interview._helps = lambda knob, upper: False
    monkeypatch.setattr(GLISp, "foresight", None)
    monkeypatch.setattr(type(interview.known), "missed", [])
    assert status_view(interview)["outlook"] is None


def test_nothing_is_said_of_an_experiment_that_the_person_asked_for():
    interview, _ = asked(*[Choice.LEFT] * 5, n_max=9)
    assert "experiment 7" in interview.known.promise
    interview.do(actions.AskFor(np.array(THETA)))
    proceed(interview)
    assert interview.known.promise == ""


def test_where_kpis_do_not_explain_the_answers_that_is_said(monkeypatch):
    monkeypatch.setattr(GLISp, "foresight", Foresight(None, 3))
    interview, _ = asked(*[Choice.LEFT] * 5, n_max=9)
    assert "may follow from more than the KPIs" in " ".join(status_view(interview)["outlook"]["sentences"])
    assert "%" not in interview.known.promise
