import numpy as np
import pytest

from prefcal_env.calibrators import Criterion, Lexicographic
from prefcal_env.errors import SettingsError
from prefcal_env.preference import Preference
from prefcal_scenarios.bench.judges import ByCost, ByCriteria, Flipping, Outcome
from support.short_runs import short_run


def outcome(x, cost=None):
    return Outcome(np.array([x, 0.0]), float(x if cost is None else cost))


def test_the_lower_cost_is_preferred_whoever_is_asked_about_first():
    a, b = outcome(1), outcome(2)
    assert ByCost().prefer(a, b) is Preference.CHALLENGER
    assert ByCost().prefer(b, a) is Preference.INCUMBENT
    assert ByCost().prefer(a, outcome(5, cost=1)) is Preference.TIE


def test_criteria_look_at_the_experiments():
    judge = ByCriteria(Lexicographic([Criterion("level", lambda e: e.x[-1, 0], 0.1)]))
    low, high = (Outcome(np.zeros(1), None, short_run([0.0], value=value)) for value in (1.0, 2.0))
    assert judge.prefer(low, high) is Preference.CHALLENGER
    assert judge.prefer(high, low) is Preference.INCUMBENT


@pytest.mark.parametrize("judge", [ByCost(), ByCriteria(Lexicographic([Criterion("x", id)]))])
def test_an_outcome_without_what_is_judged_by_is_no_outcome(judge):
    nothing = Outcome(np.zeros(1), None)
    with pytest.raises(SettingsError, match="without"):
        judge.prefer(nothing, nothing)


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_that_share_of_the_answers_is_wrong(share):
    rng = np.random.default_rng(0)
    pairs = [(outcome(a), outcome(b)) for a, b in rng.random((4000, 2))]
    judge = Flipping(ByCost(), share, seed=3)
    wrong = np.mean([judge.prefer(*pair) != ByCost().prefer(*pair) for pair in pairs])
    assert wrong == pytest.approx(share, abs=0.02)  # 3 standard deviations: 0.014, 0.019


def test_the_same_mistake_is_made_when_asked_again_or_the_other_way_round():
    rng = np.random.default_rng(1)
    judge, other = (Flipping(ByCost(), 0.5, seed) for seed in (3, 4))
    pairs = [(outcome(a), outcome(b)) for a, b in rng.random((60, 2))]
    answers = [judge.prefer(a, b) for a, b in pairs]
    assert [judge.prefer(a, b) for a, b in pairs] == answers
    assert [-judge.prefer(b, a) for a, b in pairs] == answers
    assert [other.prefer(a, b) for a, b in pairs] != answers


def test_a_tie_stays_a_tie():
    judge = Flipping(ByCost(), 1.0, seed=0)
    assert judge.prefer(outcome(1), outcome(2, cost=1)) is Preference.TIE


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan])
def test_an_impossible_share_says_so(share):
    with pytest.raises(SettingsError, match="share"):
        Flipping(ByCost(), share, seed=0)
