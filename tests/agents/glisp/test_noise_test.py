"""The noise test: are some answers wrong, and which shape suits such answers?"""

import numpy as np
import pytest

from prefcal_agents.glisp.fits import MANY, NoiseTest, evidence_of_mistakes, rows_of, suited_shape
from prefcal_agents.lessons import Preferences
from prefcal_agents.surrogate import Shape

ROUND = Shape(1.0, (1.0, 1.0))
RATE = 0.1


def compared(flipped=(), *, seed=0, count=30, cost=lambda z: np.sum((z - 0.4) ** 2, axis=1)):
    """Random samples, each compared with an earlier one; the answers of `flipped` are wrong."""
    rng = np.random.default_rng(seed)
    samples, challengers = rng.random((count, 2)), np.arange(1, count)
    rivals = np.array([int(rng.integers(k)) for k in challengers], dtype=np.int64)
    costs = cost(samples)
    b = np.sign(costs[challengers] - costs[rivals]).astype(np.int64)
    b[[k - 1 for k in flipped]] *= -1
    return Preferences(samples, challengers, rivals, b, np.ones(count - 1))


def noise_of(preferences):
    """Return the noise test of these comparisons, the first of a study."""
    shape = suited_shape(preferences, ROUND, RATE, answered=30, first=True)
    return NoiseTest(shape, evidence_of_mistakes(preferences, shape, RATE))


def only_ties():
    known = compared()
    return Preferences(known.samples, known.first, known.second, 0 * known.b, known.weights)


def test_mistakes_are_suspected_and_consistent_answers_are_not():
    right = [noise_of(compared(seed=seed)).suspects for seed in range(4)]
    wrong = [noise_of(compared((5, 11, 16, 20, 27), seed=seed)).suspects for seed in range(6)]
    assert not any(right)
    assert sum(wrong) >= 4


@pytest.mark.parametrize(("evidence", "suspects"), [(-3.0, False), (1.0, False), (1.01, True)])
def test_a_suspicion_takes_more_than_one_nat(evidence, suspects):
    assert NoiseTest(ROUND, evidence).suspects is suspects


def test_ties_are_no_evidence_and_leave_the_shape():
    assert evidence_of_mistakes(only_ties(), ROUND, RATE) == 0
    assert suited_shape(only_ties(), ROUND, RATE, answered=30, first=True) == ROUND


def test_only_the_first_test_may_choose_any_epsilon():
    known, far = compared(count=60), Shape(5.6, (1.0, 1.0))
    assert suited_shape(known, far, RATE, answered=30, first=True).epsilon < 3.2
    assert suited_shape(known, far, RATE, answered=31, first=False).epsilon >= 3.2


def test_the_knobs_take_turns_and_one_that_hardly_matters_comes_to_count_less():
    known = compared(count=MANY, cost=lambda z: np.sin(9 * z[:, 1]))
    shape = ROUND
    for answered in range(30, 40):
        shape = suited_shape(known, shape, RATE, answered=answered, first=False)
        assert np.prod(shape.scales) == pytest.approx(1.0)
        assert max(shape.scales) <= 16 * min(shape.scales)
    assert shape.scales[1] > 2 * shape.scales[0]


def test_beyond_many_comparisons_the_shape_stays():
    assert len(compared(count=MANY + 2)) == MANY + 1
    known, far = compared(count=MANY + 2), Shape(5.6, (1.0, 1.0))
    assert suited_shape(known, far, RATE, answered=MANY + 2, first=False) == far


def test_each_comparison_is_one_row():
    known = compared(count=5)
    features = ROUND.basis(known.samples, known.samples)
    rows = rows_of(known, ROUND)
    assert rows.rows.shape == (4, 5)
    gaps = features[known.first] - features[known.second]
    # A row and its number say the same: the lower cost is on the negative side.
    parallel = np.abs(np.sum(rows.rows * gaps, axis=1))
    assert parallel == pytest.approx(np.linalg.norm(rows.rows, axis=1) * np.linalg.norm(gaps, axis=1))
