"""A latent cost with a tie band and noise, and a calibrator that is wrong in a share of cases."""

import re
from dataclasses import dataclass

import numpy as np
import pytest

from prefcal_env.calibrators import BradleyTerry, Flipping, LatentCost, Thurstone
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.answer import Answer, Preference
from support.short_runs import final_level, short_run

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


SURE = LatentCost(lambda one: one.cost)


@dataclass(frozen=True)
class Tried:
    theta: np.ndarray
    cost: float


def tried(x, cost=None):
    return Tried(np.array([x, 0.0]), float(x if cost is None else cost))


class Says:
    def __init__(self, verdict):
        self.verdict = verdict

    def prefer(self, challenger, incumbent):
        return self.verdict


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_that_share_of_the_answers_is_wrong(share):
    rng = np.random.default_rng(0)
    pairs = [(tried(a), tried(b)) for a, b in rng.random((4000, 2))]
    judge = Flipping(SURE, share, seed=3)
    wrong = np.mean([judge.prefer(*pair) != SURE.prefer(*pair) for pair in pairs])
    assert wrong == pytest.approx(share, abs=0.02)  # 3 standard deviations: 0.014, 0.019


def test_another_seed_makes_other_mistakes():
    judge, other = (Flipping(SURE, 0.5, seed) for seed in (3, 4))
    pairs = [(tried(a), tried(b)) for a, b in np.random.default_rng(1).random((60, 2))]
    assert [judge.prefer(a, b) for a, b in pairs] != [other.prefer(a, b) for a, b in pairs]


@pytest.mark.parametrize(
    ("verdict", "flipped"),
    [
        (-1, Preference.INCUMBENT),
        (Preference.TIE, Preference.TIE),
        (None, None),
        (Answer(1, strength=3), Answer(-1, strength=3)),
    ],
)
def test_whatever_the_answer_its_opposite_is_given(verdict, flipped):
    assert Flipping(Says(verdict), 1.0, seed=0).prefer(tried(1), tried(2)) == flipped


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan])
def test_an_impossible_share_says_so(share):
    with pytest.raises(SettingsError, match="share"):
        Flipping(SURE, share, seed=0)
