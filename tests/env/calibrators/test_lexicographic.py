"""Criteria in order of importance."""

import numpy as np
import pytest

from prefcal_env.calibrators import Criterion, Lexicographic
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.preferences.answer import Preference
from support.short_runs import final_level, short_run

LEVEL = Criterion("level", final_level, just_noticeable=0.5)
LONGER = Criterion("duration", lambda e: e.duration, lower_is_better=False)


def test_the_first_criterion_that_tells_them_apart_decides():
    rules = Lexicographic([LEVEL, LONGER])
    low_short = short_run([0.0], value=1.0, duration=1.0)
    high_long = short_run([0.1], value=2.0, duration=2.0)
    high_short = short_run([0.2], value=2.2, duration=1.0)
    assert rules.prefer(low_short, high_long) is Preference.CHALLENGER
    assert rules.prefer(high_short, high_long) is Preference.INCUMBENT


def test_nothing_to_tell_apart_is_a_tie():
    pair = short_run([0.0], value=1.0), short_run([0.1], value=1.4)
    assert Lexicographic([LEVEL, LONGER]).prefer(*pair) is Preference.TIE


def test_an_interrupted_experiment_loses_whatever_the_criteria():
    stopped = short_run([0.0], value=0.0, end=End.UNSAFE)
    assert Lexicographic([LEVEL]).prefer(stopped, short_run([0.1])) is Preference.INCUMBENT


def test_of_two_interrupted_experiments_the_longer_is_better():
    longer = short_run([0.0], value=9.0, duration=2.0, end=End.FAILED)
    shorter = short_run([0.1], value=0.0, duration=1.0, end=End.UNSAFE)
    assert Lexicographic([LEVEL]).prefer(longer, shorter) is Preference.CHALLENGER


def test_what_comes_first_comes_before_survival():
    rules = Lexicographic([LONGER], first=[LEVEL])
    stopped = short_run([0.0], value=0.0, end=End.UNSAFE)
    high = short_run([0.1], value=1.0)
    low = short_run([0.2], value=0.3)
    assert rules.decide(stopped, high) == (Preference.CHALLENGER, LEVEL)
    verdict, criterion = rules.decide(stopped, low)
    assert verdict is Preference.INCUMBENT
    assert criterion.name == "survival"


def test_two_that_were_stopped_together_are_a_tie_whatever_comes_after():
    a, b = (short_run([v], value=v, end=End.UNSAFE) for v in (0.0, 9.0))
    assert Lexicographic([LEVEL]).decide(a, b) == (Preference.TIE, None)


def test_it_says_which_criterion_decided():
    rules = Lexicographic([LEVEL, LONGER])
    one, longer = short_run([0.0], duration=1.0), short_run([0.1], duration=2.0)
    assert rules.decide(longer, one) == (Preference.CHALLENGER, LONGER)
    assert rules.decide(one, one) == (Preference.TIE, None)


def test_thresholds_let_preferences_go_round_in_a_circle():
    rules = Lexicographic([LEVEL, LONGER])
    a = short_run([0.0], value=0.0, duration=1.0)
    b = short_run([0.1], value=0.4, duration=2.0)
    c = short_run([0.2], value=0.8, duration=3.0)
    assert rules.prefer(c, b) is rules.prefer(b, a) is rules.prefer(a, c) is Preference.CHALLENGER


def test_infinite_values_are_compared():
    never = Criterion("settled", lambda e: np.inf)
    pair = short_run([0.0]), short_run([0.1])
    assert Lexicographic([never]).prefer(*pair) is Preference.TIE


@pytest.mark.parametrize(("criteria", "first"), [([], []), ([final_level], []), ([LEVEL], [final_level])])
def test_no_criterion_and_something_else_are_refused(criteria, first):
    with pytest.raises(SettingsError, match="one or more Criterion"):
        Lexicographic(criteria, first=first)


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_an_impossible_threshold_is_refused(value):
    with pytest.raises(SettingsError, match="'level': just_noticeable must be finite and not below 0"):
        Criterion("level", final_level, just_noticeable=value)


def test_a_value_that_is_nan_is_refused():
    with pytest.raises(SettingsError, match="'broken' must be a number"):
        Lexicographic([Criterion("broken", lambda e: np.nan)]).prefer(short_run([0.0]), short_run([0.1]))
