"""What is read from a screening agent, when, and what of it front ends get."""

import numpy as np
import pytest

from prefcal_agents import GLISp
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.reason import Reason
from prefcal_env.errors import KnobError, ScenarioError
from prefcal_scenarios.app.screening import screened_of
from prefcal_scenarios.app.session import Choice, Phase
from support.interviews import begin, proceed
from support.looks import toy
from support.screened import explained, screening, simulate

REASON = Reason(0.3, ("t_f",), ("final",), ("t_f",))


@pytest.fixture
def chances(monkeypatch):
    """What the agent says, set by a test; it counts how often it was asked."""
    said = {"chance": 0.5, "asked": 0}

    def chance(agent):
        said["asked"] += 1
        return said["chance"]

    monkeypatch.setattr(Screening, "chance_of_better", property(chance))
    monkeypatch.setattr(Screening, "reason", property(lambda agent: REASON))
    return said


def answered(interview, *choices):
    for choice in choices:
        interview.answer(interview.now().question.id, choice)
        explained(interview)
    return interview


def test_other_agents_and_those_without_simulations_have_none():
    assert screened_of(GLISp(toy.space, n_init=2, n_max=3)) is None
    assert screened_of(Screening(toy.space, n_max=3)) is None
    interview = begin(toy)
    proceed(interview)
    assert not interview.screens
    assert interview.screened() is interview.wait_for_screened(9.0) is None


def test_it_is_worked_out_once_per_question_and_without_the_lock(chances):
    interview = screening()
    proceed(interview)
    assert interview.screened() is None  # no request computes it
    version = interview.now().version
    explained(interview)
    assert interview.now().version == version + 1  # pages are told
    assert chances["asked"] == 1
    for _ in range(3):
        assert interview.screened().reason == REASON
    assert not interview.work()
    assert chances["asked"] == 1


def test_it_is_about_the_open_question_alone(chances):
    interview = explained(screening())
    before = interview.screened()
    interview.answer(interview.now().question.id, Choice.LEFT)
    assert interview.screened() is None
    assert interview.screened(current=False) is before
    explained(interview)
    found = interview.screened()
    interview.ask_for(np.array([0.5, 21.0, 1.0]))
    assert interview.screened() is None  # the same record, and yet another challenger
    interview.undo(interview.now().version)
    assert interview.screened() is None
    assert found is not before


def test_before_an_answer_that_teaches_nothing_is_promised(chances):
    chances["chance"] = 0.05
    interview = explained(screening())
    assert interview.screened().prospect is None
    assert interview.outlook is None
    answered(interview, Choice.CANNOT_TELL)
    assert interview.outlook is None
    answered(interview, Choice.LEFT)
    assert interview.screened().prospect.stop
    n = len(interview.screened().bank)
    assert interview.outlook.advice.lower().endswith(
        f"nothing among the {n} simulated is expected to be preferred to the best so far (chance "
        "of the most promising: 5 %)."
    )


def test_the_advice_for_other_agents_is_never_given_beside_it(chances):
    interview = explained(screening(n_max=9))
    answered(interview, *[Choice.LEFT] * 6)
    assert interview.advice is not None
    assert interview.advice.text not in interview.outlook.text
    assert "most promising" in interview.outlook.advice


def test_at_the_end_it_is_worked_out_for_the_last_answer(chances):
    interview = explained(screening(n_max=3))
    answered(interview, Choice.LEFT, Choice.LEFT)
    assert interview.now().phase is Phase.OVER
    found = interview.screened()
    assert found.reason is None
    assert "a chance of 50 %" in interview.outlook.advice


def test_an_error_leaves_the_question_and_is_not_tried_forever(monkeypatch):
    def broken(agent):
        raise ValueError("singular")

    monkeypatch.setattr(Screening, "chance_of_better", property(broken))
    interview = screening()
    now = proceed(interview)
    assert interview.work()
    assert not interview.work()
    assert interview.now().question == now.question
    assert interview.screened() is None


def test_a_look_records_nothing_and_a_question_about_it_comes_at_once():
    interview = explained(screening())
    events = len(list(interview.study.events()))
    theta = np.array([0.5, 21.0, 1.0])
    found = interview.look_at(theta)
    assert found == toy.run(theta)
    assert len(list(interview.study.events())) == events
    assert interview.ask_for(theta).phase is Phase.QUESTION  # without another run


def test_a_look_at_one_that_was_shown_reads_its_experiment():
    interview = explained(screening())
    shown = interview.experiment(0)
    assert interview.look_at(shown.theta) == shown


def test_only_what_is_simulated_can_be_looked_at():
    interview = begin(toy)
    proceed(interview)
    with pytest.raises(ScenarioError, match="simulated unseen"):
        interview.look_at(np.array([0.5, 21.0, 1.0]))
    with pytest.raises(KnobError, match="T_s"):
        explained(screening()).look_at(np.array([9.0, 21.0, 1.0]))


def test_rows_of_the_bank_are_found_by_theta():
    interview = explained(screening())
    screened = interview.screened()
    index = interview.now().question.challenger.index
    theta = np.array(interview.now().state.history.samples[index].theta)
    row = screened.row(theta)
    assert toy.space.close(theta, screened.bank.thetas[[row]]).all()
    names = screened.bank.names
    found = dict(zip(names, screened.bank.kpis[row], strict=True))
    assert found == pytest.approx(simulate(theta), rel=0.1, abs=0.01)
    assert screened.row(theta * [0.5, 1.0, 1.0]) is None
    first = screened.bank.thetas[5]
    assert screened.row(first) == 5
