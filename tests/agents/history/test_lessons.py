"""What a history teaches, as arrays."""

import numpy as np

from prefcal_agents.history.lessons import Preferences, scores_of
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube


def told(*answers):
    history = History()
    for h, answer in enumerate(answers):
        history = history.with_pending(in_cube(np.array([float(h), 0.5])))
        history = history.told(Answer.of(answer), history.incumbent)
    return history


def test_preferences_name_the_samples_that_were_compared():
    taught = Preferences.of(told(None, 1, -1, 0, None, Answer(-1, strength=3)))
    assert taught.first.tolist() == [1, 2, 3, 5]
    assert taught.second.tolist() == [0, 0, 2, 2]
    assert taught.b.tolist() == [1, -1, 0, -1]
    assert taught.weights.tolist() == [1, 1, 1, 3]
    assert taught.samples.shape == (6, 2)


def test_a_later_answer_keeps_its_rival_when_an_earlier_one_is_retracted():
    taught = Preferences.of(told(None, -1, -1).retracted(1))
    assert taught.first.tolist() == [2]
    assert taught.second.tolist() == [1]


def test_the_first_answer_teaches_nothing():
    taught = Preferences.of(told(-1))
    assert len(taught) == 0
    assert taught.samples.shape == (1, 2)


def test_a_score_teaches_no_preference_even_if_a_study_file_holds_one():
    history = told(Answer(None, value=2.0), Answer(-1, value=1.0))
    assert len(Preferences.of(history)) == 0
    assert scores_of(history)[1].tolist() == [2.0, 1.0]
