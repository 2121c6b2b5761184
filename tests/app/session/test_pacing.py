"""Questions per experiment, changed in the middle of an interview."""

import pytest

from prefcal_app.session import Phase, actions
from prefcal_app.session.study import agent_of, questions_of
from prefcal_env.errors import StaleError, StudyError
from support.interviews import THREE, begin, judge, proceed, reopened, until_further


def answer(interview):
    now = proceed(interview)
    interview.do(actions.Answer(now.question.id, judge(now.question, interview.scenario.cost)))
    return proceed(interview)


def pair(question):
    return question.challenger.index, question.incumbent.index


def test_an_open_further_question_disappears_when_there_are_to_be_fewer(toy):
    interview = begin(toy, n_max=8, agent=THREE)
    question = until_further(interview)
    assert interview.do(actions.Pace(2)).question.id == question.id
    interview.do(actions.Pace(1))
    now = proceed(interview)
    assert not now.question.further
    assert now.question.challenger.index == question.challenger.index + 1
    with pytest.raises(StaleError):
        interview.do(actions.Answer(question.id, judge(question, toy.cost)))
    while answer(interview).phase is not Phase.OVER:
        pass
    assert not interview.now().state.history.follow_ups


@pytest.mark.parametrize("most", [1, 2, 12])
def test_a_study_resumes_identically_after_each_change(toy, tmp_path, most):
    """At every step the file says what the interview in memory goes on with."""
    path = tmp_path / "paced.prefcal"
    interview = begin(toy, n_max=9, agent=THREE, path=path)
    until_further(interview)
    interview.do(actions.Pace(most))
    asked = []
    while (now := proceed(interview)).phase is Phase.QUESTION:
        twin = agent_of(now.state, toy.space)
        assert twin.state == interview._driver.agent.state
        assert twin.ask() == interview._driver.agent.ask()
        asked.append(pair(now.question))
        if len(asked) == 3:
            interview.file.close()
            interview = reopened(toy, path)
            assert interview.known.questions == most
            assert pair(proceed(interview).question) == asked[-1]
        answer(interview)
    assert len(asked) > 3


def test_a_change_before_a_crash_leaves_no_question_that_is_not_asked(toy, tmp_path):
    """The question that follows was not written yet."""
    from prefcal_env.study import Adjusted

    path = tmp_path / "crash.prefcal"
    interview = begin(toy, n_max=8, agent=THREE, path=path)
    until_further(interview)
    interview.file.append(Adjusted({"questions_per_experiment": 1}))
    interview.file.close()
    resumed = reopened(toy, path)
    assert not proceed(resumed).question.further


@pytest.mark.parametrize(("settings", "most"), [({}, 1), ({"questions_per_experiment": 4}, 4), (None, 1)])
def test_a_study_says_how_many_it_asks(settings, most):
    assert questions_of({"agent": {"settings": settings}}) == most


@pytest.mark.parametrize("most", ["3", 2.5, True, None])
def test_a_strange_number_in_a_study_is_refused(most):
    with pytest.raises(StudyError, match="whole number"):
        questions_of({"agent": {"settings": {"questions_per_experiment": most}}})
