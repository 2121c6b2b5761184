"""Several questions for each experiment, from the agent to the study file and the page."""

from functools import partial

import numpy as np
import pytest

from prefcal_agents.history.lessons import Preferences
from prefcal_app.session import Choice, unattended
from prefcal_app.session.study.memory import agent_of
from prefcal_app.view import history_view
from prefcal_app.view.sides import question_view
from prefcal_env.errors import StaleError, StudyError
from prefcal_env.preferences.loop import calibrate
from prefcal_env.study import Answered, Shown, StudyFile
from prefcal_scenarios.kpis import outcome
from support.interviews import THREE, begin, judge, proceed, reopened, until_further


def test_a_whole_study_equals_the_loop_in_memory(toy):
    judge_ = toy.calibrators["synthetic"](0)
    agent = THREE(toy.space, n_init=3, n_max=8, seed=0)
    plain = list(calibrate(agent, toy.run, judge_, partial(outcome, toy)))
    interview = begin(toy, n_max=8, agent=THREE)
    list(unattended(interview, judge_))
    state = interview.now().state
    assert state.history.answered == 8
    assert len(state.history.follow_ups) == len(plain) - 8 > 0
    thetas = [np.array(sample.theta) for sample in state.history.samples]
    assert all(map(np.array_equal, thetas, agent.samples))
    assert len(agent_of(state, toy.space).history.follow_ups) == len(state.history.follow_ups)


def test_a_further_question_is_about_two_known_experiments(toy):
    interview = begin(toy, n_max=8, agent=THREE)
    question = until_further(interview)
    assert question.further
    assert {question.left.index, question.right.index} < set(interview.now().state.finished)
    sides = history_view(interview)["answers"]
    assert not any(row["further"] for row in sides)


def test_the_sides_of_a_further_question_are_randomized(toy):
    lefts = set()
    for seed in range(6):
        interview = begin(toy, n_max=8, agent=THREE, seed=seed)
        lefts.add(until_further(interview).left.challenger)
    assert lefts == {True, False}


def test_it_is_saved_resumed_undone_and_retracted(toy, tmp_path):
    path = tmp_path / "three.prefcal"
    interview = begin(toy, n_max=8, agent=THREE, path=path)
    question = until_further(interview)
    interview.file.close()
    interview = reopened(toy, path)
    assert interview.now().question == question
    interview.steps.answer(question.id, judge(question, toy.cost), comment="so")
    after = proceed(interview)
    assert after.state.history.follow_ups[0].comment == "so"
    assert after.state.history.follow_ups[0].after == after.state.history.answered
    undone = interview.steps.undo(after.version)
    assert not undone.state.history.follow_ups
    again = proceed(interview).question
    assert (again.left.index, again.right.index) == (question.left.index, question.right.index)
    interview.steps.answer(again.id, judge(again, toy.cost))
    interview.steps.retract(-1)
    assert interview.now().state.history.follow_ups[0].retracted
    with pytest.raises(StaleError, match="retracted already"):
        interview.steps.retract(-1)
    with pytest.raises(StaleError, match="no answer to a follow-up comparison 2"):
        interview.steps.retract(-2)
    interview.file.close()
    resumed = reopened(toy, path)
    assert resumed.now().state.history.follow_ups[0].retracted
    assert len(Preferences.of(resumed._flow.agent.history)) == resumed.now().state.history.answered - 1


def test_a_question_that_a_newer_algorithm_would_not_ask_is_replaced(toy, tmp_path, monkeypatch):
    path = tmp_path / "three.prefcal"
    interview = begin(toy, n_max=8, agent=THREE, path=path)
    question = until_further(interview)
    interview.file.close()
    known = {question.left.index, question.right.index}
    other = next(k for k in range(question.challenger.index) if k not in known)
    pair = question.challenger.index, other
    monkeypatch.setattr("prefcal_agents.glisp.agent.follow_up", lambda *given: pair)
    interview = reopened(toy, path)
    now = interview.now()
    assert (now.question.challenger.index, now.question.incumbent.index) == pair
    interview.file.close()
    monkeypatch.setattr("prefcal_agents.glisp.agent.follow_up", lambda *given: None)
    now = proceed(reopened(toy, path))
    assert not now.question.further
    assert now.question.challenger.index == now.state.history.answered


def test_after_contradictions_two_earlier_ones_are_asked_about(toy, tmp_path):
    path = tmp_path / "three.prefcal"
    interview, older = begin(toy, n_max=26, agent=THREE, path=path), 0
    while older < 2:
        question = proceed(interview).question
        latest = interview.now().state.history.answered - 1
        if question.further and latest not in (question.left.index, question.right.index):
            older += 1
            view = asked_now(interview)
            best = interview.now().incumbent
            for side in ("left", "right"):
                is_best = getattr(question, side).index == best
                assert view[side]["role"] == ("best so far" if is_best else "")
            interview.file.close()
            interview = reopened(toy, path)
            assert interview.now().question == question
        better = judge(question, toy.cost) is Choice.LEFT
        mistaken = question.number % 3 == 1 and not question.further
        interview.steps.answer(question.id, Choice.LEFT if better != mistaken else Choice.RIGHT)
    told = interview._flow.agent.history.follow_ups
    recorded = interview.now().state.history.follow_ups
    assert [(c.challenger, c.incumbent, c.answer.preference, c.after) for c in told] == [
        (c.challenger, c.incumbent, c.answer.preference, c.after) for c in recorded
    ]


def asked_now(interview):
    return question_view(interview.now().question, interview.scenario, blind=False)


def test_a_retraction_leaves_an_open_further_question_consistent(toy):
    interview = begin(toy, n_max=8, agent=THREE)
    until_further(interview)
    interview.steps.retract(1)
    now = proceed(interview)
    asked = interview._flow.agent.ask()
    assert now.question.challenger.index == asked.challenger.index
    interview.steps.answer(now.question.id, judge(now.question, toy.cost))
    assert proceed(interview).question is not None


def test_running_ahead_changes_nothing(toy):
    def answers(ahead):
        interview = begin(toy, n_max=7, agent=THREE, ahead=ahead)
        while (now := proceed(interview)).question is not None:
            while ahead and interview.work():
                pass
            interview.steps.answer(now.question.id, judge(now.question, toy.cost))
        state = interview.now().state
        return [(c.challenger, c.incumbent, c.answer) for c in state.answers]

    assert answers(ahead=True) == answers(ahead=False)


def test_a_file_that_compares_an_experiment_before_its_own_question_is_refused(toy):
    interview = begin(toy, n_max=8, agent=THREE)
    question = until_further(interview)
    new, old = question.challenger.index, question.incumbent.index
    study: StudyFile = interview.file
    [shown] = study.append(Shown(new, old, True))
    verdict = interview.now().state.history.comparisons[-1].answer
    with pytest.raises(StudyError, match="is not open"):
        study.append(Answered(shown, old, new, verdict))
