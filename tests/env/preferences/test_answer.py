"""Answers and queries: values that refuse what they are not."""

import json

import numpy as np
import pytest

from prefcal_env.errors import PreferenceError
from prefcal_env.preferences.answer import Answer, Mark, Preference, Query, Suggestion


def test_preferences_are_those_of_the_paper():
    assert (Preference.CHALLENGER, Preference.TIE, Preference.INCUMBENT) == (-1, 0, 1)


@pytest.mark.parametrize("value", [-1, 0, 1, np.int64(-1), np.sign(-0.3), 1.0, Preference.TIE, None])
def test_bare_numbers_are_answers_and_none_abstains(value):
    assert Answer.of(value).preference == value


@pytest.mark.parametrize("value", [2, -2, 0.5, True, np.inf, "left", np.nan, [1]])
def test_anything_else_is_refused_with_what_was_expected(value):
    with pytest.raises(PreferenceError, match=r"must be -1 .*None"):
        Answer.of(value)


@pytest.mark.parametrize("strength", [0, -1, np.inf, np.nan])
def test_strength_is_positive_and_finite(strength):
    with pytest.raises(PreferenceError, match="strength"):
        Answer(Preference.TIE, strength=strength)


@pytest.mark.parametrize("value", [np.inf, np.nan, "low", True])
def test_a_score_is_a_finite_number(value):
    with pytest.raises(PreferenceError, match="a score must be a finite number"):
        Answer(None, value=value)


@pytest.mark.parametrize("preference", [Preference.TIE, None])
def test_a_stronger_tie_means_nothing(preference):
    answer = Answer(preference, strength=3)
    assert answer == Answer(preference)


def test_marks_are_marks():
    assert Answer(None, marks=[Mark.CHALLENGER_UNSAFE]).marks == (Mark.CHALLENGER_UNSAFE,)
    with pytest.raises(PreferenceError, match="a mark must be"):
        Answer(None, marks=("unsafe",))


def test_automatic_marks_are_marks_and_survive_json():
    marks = (Mark.INCUMBENT_UNSAFE, Mark.CHALLENGER_UNSAFE)
    answer = Answer(1, marks=marks, automatic=marks[:1])
    assert Answer.from_dict(json.loads(json.dumps(answer.to_dict()))) == answer
    with pytest.raises(PreferenceError, match="automatic must be some of the marks"):
        Answer(1, automatic=marks)


def test_queries_are_equal_by_value():
    one = Query(Suggestion(1, np.array([1.0, 2.0])), Suggestion(0, np.array([0.0, 0.0])))
    same = Query(Suggestion(1, np.array([1.0, 2.0])), Suggestion(0, np.array([0.0, 0.0])))
    other = Query(Suggestion(1, np.array([1.0, 2.5])), Suggestion(0, np.array([0.0, 0.0])))
    assert one == same
    assert hash(one) == hash(same)
    assert one != other
    assert one != Query(one.challenger)


def test_a_suggestions_theta_cannot_be_changed():
    suggestion = Suggestion(0, np.array([1.0]))
    with pytest.raises(ValueError, match="read-only"):
        suggestion.theta[0] = 2.0
