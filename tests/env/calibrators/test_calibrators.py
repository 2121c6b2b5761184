"""Every calibrator keeps the contract; what each does on top of it."""

import re
from typing import Any

import numpy as np
import pytest

from contracts.calibrators import calibrator_contract
from prefcal_env import HumanCalibrator
from prefcal_env.calibrators import BradleyTerry, Criterion, LatentCost, Lexicographic, Thurstone
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.preferences.answer import Answer, Mark, Preference
from prefcal_scenarios.cases.cstr import cstr
from support.short_runs import final_level, short_run

SUBJECTS: dict[str, Any] = {
    "latent cost": lambda: LatentCost(final_level),
    "latent cost with a tie band": lambda: LatentCost(final_level, tie_band=0.1),
    "latent cost, Thurstone": lambda: LatentCost(final_level, noise=Thurstone(0.5), seed=3),
    "latent cost, Bradley-Terry": lambda: LatentCost(final_level, noise=BradleyTerry(0.5)),
    "a person": lambda: HumanCalibrator(LatentCost(final_level).prefer),
    "a person, sides shuffled": lambda: HumanCalibrator(LatentCost(final_level).prefer, shuffle=1),
    "lexicographic": lambda: Lexicographic([Criterion("level", final_level)]),
    "lexicographic with thresholds": lambda: Lexicographic(
        [
            Criterion("level", final_level, just_noticeable=1.0),
            Criterion("calm", lambda e: e.duration, lower_is_better=False),
        ]
    ),
}


@calibrator_contract
@pytest.mark.parametrize("subject", SUBJECTS)
def test_calibrator(clause, subject):
    clause(SUBJECTS[subject])


def test_the_cstr_room_has_calibrators_that_are_made_from_a_seed():
    assert set(cstr.calibrators) == {"synthetic", "lexicographic"}
    for make in cstr.calibrators.values():
        assert hasattr(make(seed=3), "prefer")


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


LOW, HIGH = short_run([1.0], value=1.0), short_run([2.0], value=1.3)


def test_the_lower_cost_is_preferred():
    assert LatentCost(final_level).prefer(LOW, HIGH) is Preference.CHALLENGER
    assert LatentCost(final_level).prefer(HIGH, LOW) is Preference.INCUMBENT


def test_costs_within_the_tie_band_are_a_tie():
    assert LatentCost(final_level, tie_band=0.31).prefer(LOW, HIGH) is Preference.TIE
    assert LatentCost(final_level, tie_band=0.29).prefer(LOW, HIGH) is Preference.CHALLENGER


def test_infinite_costs_are_compared():
    cost = LatentCost(lambda e: np.inf if e.theta[0] > 1 else 0.0)
    other = short_run([3.0])
    assert cost.prefer(HIGH, LOW) is Preference.INCUMBENT
    assert cost.prefer(HIGH, other) is Preference.TIE


def share_right(noise, difference: float, n: int = 4000) -> float:
    judge = LatentCost(final_level, noise=noise)
    right = 0
    for i in range(n):
        better = short_run([float(i)], value=0.0)
        worse = short_run([i + 0.5], value=difference)
        right += judge.prefer(better, worse) is Preference.CHALLENGER
    return right / n


def test_thurstone_errs_as_often_as_case_v_says():
    # P = Phi(1/(sqrt(2) 1)) = 0.760
    assert share_right(Thurstone(1.0), 1.0) == pytest.approx(0.760, abs=0.025)


def test_bradley_terry_errs_as_often_as_its_formula_says():
    # P = 1/(1 + exp(-1)) = 0.731
    assert share_right(BradleyTerry(1.0), 1.0) == pytest.approx(0.731, abs=0.025)


def test_another_seed_errs_elsewhere():
    def verdicts(seed: int) -> list[Preference]:
        judge = LatentCost(final_level, noise=Thurstone(1.0), seed=seed)
        pairs = [(short_run([i]), short_run([i + 0.5])) for i in range(20)]
        return [judge.prefer(a, b) for a, b in pairs]

    assert verdicts(0) == verdicts(0) != verdicts(1)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"tie_band": -0.1}, "tie_band must be finite and not below 0, got -0.1"),
        ({"tie_band": np.nan}, "tie_band"),
        ({"noise": 0.3}, "Thurstone, BradleyTerry or None, got 0.3"),
        ({"seed": -1}, "seed must be an integer, 0 or more, got -1"),
        ({"seed": 1.5}, "seed"),
        ({"cost": 3}, "cost must be a function"),
    ],
)
def test_impossible_options_are_refused(options, reason):
    with pytest.raises(SettingsError, match=reason):
        LatentCost(**{"cost": final_level} | options)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_noise_without_a_positive_scale_is_refused(value):
    with pytest.raises(SettingsError, match="sigma must be finite and above 0"):
        Thurstone(value)
    with pytest.raises(SettingsError, match="scale must be finite and above 0"):
        BradleyTerry(value)


@pytest.mark.parametrize("value", [np.nan, None, "low", [1, 2]])
def test_a_cost_that_is_no_number_is_refused(value):
    with pytest.raises(SettingsError, match=re.escape(f"got {value!r} at θ")):
        LatentCost(lambda e: value).prefer(LOW, HIGH)


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
