"""Which experiments of a study count as unsafe though nobody said so."""

import pytest

from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.study import Answered, Finished, Retracted, Shown, Suggested, Undone
from support.studies import experiment, small_study

NEW, OLD = Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE


@pytest.fixture
def study():
    """Experiments 0 to 2; an answer to number 3 that marks both sides by itself."""
    with small_study(":memory:", answers=2) as file:
        file.append(Suggested(3, (0.9,), (0.9,)), (Finished(3), experiment(0.9)))
        (shown,) = file.append(Shown(3, 1, True))
        answer = Answer(1, marks=(NEW, OLD), automatic=(NEW, OLD))
        file.append(Answered(shown, 3, 1, answer))
        yield file


def test_marks_count_for_the_experiment_of_their_side(study):
    assert study.state.history.unsafe(automatic=True) == {1, 3}


@pytest.mark.parametrize("event", [Undone(), Retracted(3)])
def test_an_answer_that_is_taken_back_takes_its_marks_along(study, event):
    study.append(event)
    assert study.state.history.unsafe(automatic=True) == frozenset()


def test_the_person_s_own_marks_are_not_among_them(study):
    study.append(Undone())
    (shown,) = study.append(Shown(3, 1, True))
    study.append(Answered(shown, 3, 1, Answer(1, marks=(NEW, OLD), automatic=(OLD,))))
    assert study.state.history.unsafe(automatic=True) == {1}


def test_further_answers_count_too(study):
    study.append(Undone())
    (shown,) = study.append(Shown(2, 0, True))
    study.append(Answered(shown, 2, 0, Answer(1, marks=(OLD,), automatic=(OLD,))))
    assert study.state.history.unsafe(automatic=True) == {0}
