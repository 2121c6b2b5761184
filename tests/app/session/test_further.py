"""Several questions for each experiment, from the agent to the study file and the page."""

import pytest

from prefcal_agents.lessons import Preferences
from prefcal_app.session import actions
from prefcal_env.errors import StaleError, StudyError
from prefcal_env.study import Answered, Shown, StudyFile
from support.interviews import THREE, begin, judge, proceed, reopened, until_further


def test_it_is_saved_resumed_undone_and_retracted(toy, tmp_path):
    path = tmp_path / "three.prefcal"
    interview = begin(toy, n_max=8, agent=THREE, path=path)
    question = until_further(interview)
    interview.file.close()
    interview = reopened(toy, path)
    assert interview.now().question == question
    interview.do(actions.Answer(question.id, judge(question, toy.cost), comment="so"))
    after = proceed(interview)
    assert after.state.history.follow_ups[0].comment == "so"
    assert after.state.history.follow_ups[0].after == after.state.history.answered
    undone = interview.do(actions.Undo(after.version))
    assert not undone.state.history.follow_ups
    again = proceed(interview).question
    assert (again.left.index, again.right.index) == (question.left.index, question.right.index)
    interview.do(actions.Answer(again.id, judge(again, toy.cost)))
    interview.do(actions.Retract(-1))
    assert interview.now().state.history.follow_ups[0].retracted
    with pytest.raises(StaleError, match="retracted already"):
        interview.do(actions.Retract(-1))
    with pytest.raises(StaleError, match="no answer to a follow-up comparison 2"):
        interview.do(actions.Retract(-2))
    interview.file.close()
    resumed = reopened(toy, path)
    assert resumed.now().state.history.follow_ups[0].retracted
    assert len(Preferences.of(resumed._driver.agent.history)) == resumed.now().state.history.answered - 1


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


def test_a_file_that_compares_an_experiment_before_its_own_question_is_refused(toy):
    interview = begin(toy, n_max=8, agent=THREE)
    question = until_further(interview)
    new, old = question.challenger.index, question.incumbent.index
    study: StudyFile = interview.file
    [shown] = study.append(Shown(new, old, True))
    verdict = interview.now().state.history.comparisons[-1].answer
    with pytest.raises(StudyError, match="is not open"):
        study.append(Answered(shown, old, new, verdict))
