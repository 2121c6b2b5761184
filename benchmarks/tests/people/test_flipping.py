"""The stated share of the answers is wrong, and the same answers in every study."""

from dataclasses import dataclass

import numpy as np
import pytest

from contracts.calibrators import calibrator_contract
from prefcal_bench.people.flipping import Flipping
from prefcal_env.calibrators import LatentCost
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.answer import Answer, Preference
from support.short_runs import final_level


@calibrator_contract
def test_calibrator(clause):
    clause(lambda: Flipping(LatentCost(final_level), 0.2, seed=3))


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
