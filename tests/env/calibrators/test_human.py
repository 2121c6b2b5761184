"""A person in Python: their answers, sides shuffled and turned back."""

import pytest

from prefcal_env import HumanCalibrator
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.answer import Answer, Mark, Preference
from support.short_runs import short_run

NEW, BEST = short_run([0.1], value=1.0), short_run([0.2], value=2.0)


@pytest.mark.parametrize("said", [-1, 0, 1, None, Preference.TIE])
def test_an_answer_is_passed_on(said):
    assert HumanCalibrator(lambda a, b: said).prefer(NEW, BEST) == said


def test_the_challenger_comes_first():
    asked = []
    HumanCalibrator(lambda a, b: asked.append((a, b))).prefer(NEW, BEST)
    assert asked == [(NEW, BEST)]


def test_shuffled_sides_are_turned_back():
    asked = []

    def ask(a, b):
        asked.append(a is NEW)
        return -1 if a.x[0, 0] < b.x[0, 0] else 1

    human = HumanCalibrator(ask, shuffle=3)
    answers = {human.prefer(NEW, BEST) for _ in range(20)}
    assert answers == {Preference.CHALLENGER}
    assert set(asked) == {True, False}
    again = []
    twin = HumanCalibrator(lambda a, b: again.append(a is NEW), shuffle=3)
    for _ in range(20):
        twin.prefer(NEW, BEST)
    assert again == asked


def test_marks_and_ends_are_turned_back_too():
    def ask(a, b):
        first_is_new = a is NEW
        marks = (Mark.CHALLENGER_UNSAFE if first_is_new else Mark.INCUMBENT_UNSAFE,)
        ends = ({"t": 9.0}, {"t": 1.0}) if first_is_new else ({"t": 1.0}, {"t": 9.0})
        return Answer(1 if first_is_new else -1, 2.0, marks, ends)

    human = HumanCalibrator(ask, shuffle=0)
    for _ in range(12):
        expected = Answer(1, 2.0, (Mark.CHALLENGER_UNSAFE,), ({"t": 9.0}, {"t": 1.0}))
        assert human.prefer(NEW, BEST) == expected


@pytest.mark.parametrize("shuffle", [-1, 0.5, True, "x"])
def test_an_impossible_seed_is_refused(shuffle):
    with pytest.raises(SettingsError, match="shuffle must be an integer, 0 or more"):
        HumanCalibrator(lambda a, b: 0, shuffle=shuffle)


def test_what_cannot_be_called_is_refused():
    with pytest.raises(SettingsError, match="ask must be a function"):
        HumanCalibrator("me")
