import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents import LatinHypercube
from prefcal_scenarios.app.session import Choice, Consistency
from prefcal_scenarios.app.web.view import status_view
from prefcal_scenarios.app.web.view.status import in_words
from prefcal_scenarios.scenario import KPI
from support.interviews import answer_all, begin, proceed
from support.looks import SPACE, asked, toy


def test_before_anything_is_answered_nothing_is_learned():
    interview, _ = asked()
    view = status_view(interview)
    assert view["slices"] is None
    assert sum(view["verdicts"].values()) == 0
    assert [e["number"] for e in view["tried"]["experiments"]] == [1, 2]


def test_before_the_first_experiment_there_is_no_best():
    view = status_view(begin(toy))
    assert (view["best"], view["slices"], view["tried"]["experiments"]) == (None, None, [])


def test_slices_run_through_the_best_over_the_whole_range_of_each_knob():
    interview, now = asked(Choice.LEFT, Choice.RIGHT, Choice.LEFT)
    view = status_view(interview)
    json.dumps(view, allow_nan=False)
    best = interview.experiment(now.incumbent).theta
    assert [s["best"] for s in view["slices"]] == best.tolist()
    for part, knob in zip(view["slices"], SPACE, strict=True):
        assert (part["x"][0], part["x"][-1]) == pytest.approx((knob.low, knob.high))
        assert np.all(np.diff(part["x"]) > 0)
        assert len(part["x"]) == len(part["y"])
        assert len(part["samples"]["x"]) == len(now.state.finished)


def test_the_samples_of_a_slice_lie_at_their_own_learned_cost():
    interview, now = asked(Choice.LEFT, Choice.RIGHT, Choice.LEFT)
    assert interview.surrogate is not None
    tried = np.array([interview.experiment(i).theta for i in sorted(now.state.finished)])
    cost = interview.surrogate(tried)
    for k, part in enumerate(status_view(interview)["slices"]):
        assert part["samples"]["x"] == tried[:, k].tolist()
        y = np.array(part["samples"]["y"])
        assert np.all(y >= 0)
        assert min(part["y"]) >= 0
        np.testing.assert_allclose(np.diff(y**2), np.diff(cost), atol=1e-9)
    drawn = [[*part["y"], *part["samples"]["y"]] for part in status_view(interview)["slices"]]
    assert min(map(min, drawn)) == 0


def test_the_best_is_set_off_once_and_was_best_before_that():
    interview, now = asked(*[Choice.LEFT] * 4)
    tried = status_view(interview)["tried"]["experiments"]
    assert [e["number"] for e in tried if e["best"]] == [now.incumbent + 1]
    assert tried[0]["was_best"]
    assert all(e["was_best"] for e in tried if e["best"])


def test_verdicts_are_counted_and_retracted_ones_are_not():
    interview, _ = asked(Choice.SAME, Choice.SAME, Choice.CANNOT_TELL)
    interview.retract(1)
    counted = status_view(interview)["verdicts"]
    assert sum(counted.values()) == 2
    assert sorted(counted.values()) == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("consistency", "words"),
    [
        (Consistency(0, 0, ()), "No question has been asked twice yet. "
         "The answers do not contradict each other."),
        (Consistency(3, 2, ()), "2 of 3 repeated questions got the same answer. "
         "The answers do not contradict each other."),
        (Consistency(0, 0, ((0, 4, 2),)), "No question has been asked twice yet. "
         "Preferred in a circle: 1 over 5 over 3."),
    ],
)  # fmt: skip
def test_consistency_in_words(consistency, words):
    assert in_words(consistency) == words


def test_an_earlier_question_can_be_asked_again_once_there_is_one():
    fresh, _ = asked()
    later, _ = asked(*[Choice.LEFT] * 4)
    assert status_view(fresh)["consistency"]["can_repeat"] is False
    assert status_view(later)["consistency"]["can_repeat"] is True


def test_what_counts_is_drawn_once_the_answers_tell():
    interview = begin(toy, n_max=20, agent=LatinHypercube)
    assert status_view(interview)["kpi_importance"] is None
    answer_all(interview, lambda number: None)
    found = status_view(interview)["kpi_importance"]
    json.dumps(found, allow_nan=False)
    # The toy's cost is its settling time, but for a trifle.
    assert found["sentence"].startswith("You seem to care most about: settling time t_f")
    assert found["bars"][0]["title"] == "settling time t_f"
    assert all(bar["text"] == f"{100 * bar['share']:.0f} %" for bar in found["bars"])
    assert all(0 <= bar["share"] <= 1 for bar in found["bars"])
    assert "19 answers" in found["caption"]
    assert "answers that it had not learned from" in found["trust"]


@pytest.mark.parametrize("seed", range(3, 6))
def test_nothing_stands_out_of_answers_like_coin_tosses(seed):
    rng = np.random.default_rng(seed)
    interview = begin(toy, n_max=20, agent=LatinHypercube)
    while (now := proceed(interview)).question is not None:
        interview.answer(now.question.id, rng.choice([Choice.LEFT, Choice.RIGHT]))
    found = status_view(interview)["kpi_importance"]
    assert found["sentence"].startswith("Nothing stands out yet: ")


def test_whether_to_go_on_is_said_once_enough_is_answered():
    interview, _ = asked(Choice.LEFT)
    assert status_view(interview)["outlook"] is None
    interview, _ = asked(*[Choice.LEFT] * 5)
    outlook = status_view(interview)["outlook"]
    told = " ".join(outlook["sentences"]).lower()
    assert interview.advice.text.split(":")[0].lower() in told
    json.dumps(outlook)


def test_nobody_is_advised_to_stop_while_the_best_misses_an_objective():
    hard = replace(toy, kpis=(KPI("t_f", "settling time", "h", at_most=1e-6), *toy.kpis[1:]))
    interview = begin(hard, n_max=9)
    while (now := proceed(interview)).question is not None:
        interview.answer(now.question.id, Choice.SAME)
    assert interview.advice.stop
    assert "settling time" in interview.missed
    sentences = status_view(interview)["outlook"]["sentences"]
    assert any(s.startswith("The best experiment misses the objective") for s in sentences)
    assert "time to stop" not in " ".join(sentences)
