"""A Paced event: the number of comparisons for each experiment, changed within a study."""

from dataclasses import replace

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.preference import Answer
from prefcal_env.studies import Answered, Paced, Shown, StudyFile, questions_of
from prefcal_env.studies.events import from_text, to_text
from prefcal_env.studies.fold import step
from support.interviews import clock
from support.studies import CONFIGURATION, compared

AGENT = {"agent": "GLISp", "settings": {"delta": 0.3, "questions_per_experiment": 3}}


@pytest.fixture
def study():
    """Experiments 0 to 2, all compared."""
    with StudyFile.create(":memory:", {**CONFIGURATION, "agent": AGENT}, clock=clock()) as file:
        for index, preference in enumerate((None, 1, 1)):
            compared(file, index, preference)
        yield file


def test_it_changes_the_agent_of_the_study_and_nothing_else(study):
    before = study.state
    study.append(Paced(5))
    after = study.state
    assert questions_of(after.configuration) == 5
    assert after.configuration["agent"]["settings"]["delta"] == 0.3
    assert replace(after, configuration=before.configuration) == before
    assert questions_of(before.configuration) == 3


def test_an_open_further_question_goes_where_it_is_one_too_many(study):
    study.append(Shown(2, 1, True))
    assert study.state.open is not None
    study.append(Paced(2))
    assert study.state.open is not None
    (shown,) = study.append(Paced(1))
    assert study.state.open is None
    with pytest.raises(StudyError, match="is not on show"):
        study.append(Answered(shown - 2, 2, 1, Answer(0)))


def test_answers_to_further_questions_count(study):
    (shown,) = study.append(Shown(2, 1, True))
    study.append(Answered(shown, 2, 1, Answer(1)), Shown(2, 1, True))
    study.append(Paced(2))
    assert study.state.open is None


@pytest.mark.parametrize("repeats", [None, 1])
def test_other_questions_stay(study, repeats):
    """That of a new experiment, and one that is asked again."""
    if repeats is None:
        compared(study, 3, 1)
        state = replace(study.state, closed=study.state.closed[:3], open=(90, Shown(3, 0, True)))
    else:
        state = replace(study.state, open=(90, Shown(2, 0, True, repeats)))
    assert step(state, 91, "now", Paced(1)).open == state.open


@pytest.mark.parametrize("agent", [None, [], {}, {"settings": 3}])
def test_a_study_whose_agent_has_no_settings_refuses_it(study, agent):
    state = replace(study.state, configuration={**CONFIGURATION, "agent": agent})
    with pytest.raises(StudyError, match="event 9 is impossible: the agent of the study has no"):
        step(state, 9, "now", Paced(2))


@pytest.mark.parametrize("questions", [0, -3])
def test_fewer_than_one_are_refused(study, questions):
    with pytest.raises(StudyError, match="1 or more questions"):
        study.append(Paced(questions))


def test_it_goes_through_text():
    assert from_text(*to_text(Paced(3))) == Paced(3)
    with pytest.raises(StudyError, match="questions must be int"):
        from_text("paced", '{"questions":true}')


@pytest.mark.parametrize(
    ("settings", "most"), [({}, 1), ({"questions_per_experiment": 4}, 4), (None, 1)]
)
def test_a_study_says_how_many_it_asks(settings, most):
    assert questions_of({"agent": {"settings": settings}}) == most


@pytest.mark.parametrize("most", ["3", 2.5, True, None])
def test_a_strange_number_is_refused(most):
    with pytest.raises(StudyError, match="whole number"):
        questions_of({"agent": {"settings": {"questions_per_experiment": most}}})
