"""Asking for a θ: the next question is about it, for every agent, and nothing is lost."""

import numpy as np
import pytest

from prefcal_agents import GLISp, RandomSearch
from prefcal_app.session import Choice, Phase, actions, runs
from prefcal_env.errors import KnobError, ProtocolError, StaleError, StudyError
from prefcal_env.study import Requested, verify
from support.interviews import begin, proceed, reopened
from toy_study import toy_scenario

toy = toy_scenario()
WANTED = np.array([0.5, 21.0, 1.0])


def asked(answers=1, **settings):
    """An interview with its next question open."""
    interview = begin(toy, **settings)
    for _ in range(answers):
        interview.do(actions.Answer(proceed(interview).question.id, Choice.LEFT))
    proceed(interview)
    return interview


def kinds(interview):
    """The kinds of the events on record."""
    return [type(recorded.event).__name__ for recorded in interview.file.events()]


@pytest.mark.parametrize("agent", [GLISp, RandomSearch])
def test_the_open_question_is_replaced_by_one_about_it(agent):
    interview = asked(agent=agent)
    before = interview.now().question
    interview.do(actions.AskFor(WANTED))
    now = proceed(interview)
    assert now.question.challenger.experiment.theta.tolist() == WANTED.tolist()
    assert now.question.incumbent.index == now.incumbent
    assert now.question.number == before.number
    assert now.state.requested == {2}
    with pytest.raises(StaleError, match="no longer open"):
        interview.do(actions.Answer(before.id, Choice.LEFT))
    interview.do(actions.Answer(now.question.id, Choice.LEFT))
    assert proceed(interview).question.number == before.number + 1


def test_the_former_theta_can_be_asked_for_and_its_experiment_is_found():
    interview = asked()
    former = interview.now().question.challenger.experiment
    interview.do(actions.AskFor(WANTED))
    proceed(interview)
    now = interview.do(actions.AskFor(former.theta))
    assert now.phase is Phase.QUESTION  # at once: it ran before
    assert now.question.challenger.experiment == former
    assert now.state.requested == {2}


def test_asking_for_the_one_in_question_changes_nothing():
    interview = asked()
    now = interview.now()
    after = interview.do(actions.AskFor(now.question.challenger.experiment.theta))
    assert after.question.id == now.question.id
    assert "Requested" not in kinds(interview)


def test_a_repeated_question_gives_way():
    interview = asked(2)
    interview.do(actions.Repeat())
    pending = interview.now().pending
    now = interview.do(actions.AskFor(np.array(pending.theta)))
    assert now.question.repeats is None
    assert now.question.challenger.index == pending.index


def test_resumed_undone_and_retracted_it_stays_what_was_asked_for(tmp_path):
    path = tmp_path / "a.prefcal"
    interview = asked(2, path=path)
    interview.do(actions.AskFor(WANTED))
    interview.file.close()  # before it ran
    again = reopened(toy, path)
    now = proceed(again)
    assert now.question.challenger.experiment.theta.tolist() == WANTED.tolist()
    assert again._driver.agent.history == again.file.state.history
    again.do(actions.Retract(1))
    now = proceed(again)
    assert now.question.challenger.experiment.theta.tolist() == WANTED.tolist()
    again.do(actions.Answer(now.question.id, Choice.RIGHT))
    proceed(again)
    now = again.do(actions.Undo(again.now().version))
    assert now.question.challenger.experiment.theta.tolist() == WANTED.tolist()
    assert now.state.requested == {3}
    again.do(actions.Undo(now.version))
    assert proceed(again).state.requested == set()
    assert again._driver.agent.history == again.file.state.history
    again.file.close()
    assert verify(path) == ()


def test_a_run_that_is_no_longer_needed_is_kept_for_later():
    interview = begin(toy, n_max=4)
    while interview.now().pending is None or interview.now().pending.index < 1:
        interview.work()
    former = interview.now().pending
    job = runs.due(interview._driver, ahead=False)
    found = job.run()  # it ends after the request
    interview.do(actions.AskFor(WANTED))
    job.finish(interview._driver, found)
    assert former.index not in interview.now().state.finished
    now = proceed(interview)
    assert now.question.challenger.experiment.theta.tolist() == WANTED.tolist()
    now = interview.do(actions.AskFor(np.array(former.theta)))
    assert now.question.challenger.experiment.theta.tolist() == list(former.theta)  # at once


def test_it_is_on_the_disk_before_anything_follows(monkeypatch):
    interview = asked()
    before, history = interview.now(), interview._driver.agent.history

    def full(*entries):
        raise StudyError("the disk is full")

    monkeypatch.setattr(interview.file, "append", full)
    with pytest.raises(StudyError, match="full"):
        interview.do(actions.AskFor(WANTED))
    monkeypatch.undo()
    assert interview._driver.agent.history == history
    assert interview.now() == before
    interview.do(actions.AskFor(WANTED))
    found = [r.event for r in interview.file.events() if isinstance(r.event, Requested)]
    assert [event.theta for event in found] == [tuple(WANTED)]


def test_what_cannot_be_tried_is_refused():
    interview = asked()
    events = kinds(interview)
    with pytest.raises(KnobError, match="T_s"):
        interview.do(actions.AskFor(np.array([9.0, 21.0, 1.0])))
    with pytest.raises(ProtocolError, match="experiment 1 of 2"):
        interview.do(actions.AskFor(interview.past.experiment(0).theta))
    interview.do(actions.Finish())
    with pytest.raises(StaleError, match="continue it first"):
        interview.do(actions.AskFor(WANTED))
    assert kinds(interview) == [*events, "Ended"]
    interview.do(actions.GoOn())
    proceed(interview)
    assert interview.do(actions.AskFor(WANTED)).state.requested == {2}
