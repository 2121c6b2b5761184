"""The posterior of β if some answers may be wrong."""

import numpy as np
import pytest

from prefcal_agents.glisp.noise_test import rows_of
from prefcal_agents.history.lessons import Preferences
from prefcal_agents.models.expectation_propagation import ExpectationPropagation
from prefcal_agents.models.preference_qp import Constraints
from prefcal_agents.models.surrogate import Shape

SHAPE = Shape(1.0, (1.0, 1.0))


def compared(flipped, *, seed=0, count=60):
    """Return `count` comparisons of 30 samples of a bowl; the answers of `flipped` are wrong."""
    rng = np.random.default_rng(seed)
    samples = rng.random((30, 2))
    cost = np.sum((samples - 0.4) ** 2, axis=1)
    pairs = np.array([rng.choice(30, 2, replace=False) for _ in range(count)])
    b = np.sign(cost[pairs[:, 0]] - cost[pairs[:, 1]]).astype(np.int64)
    b[list(flipped)] *= -1
    return Preferences(samples, pairs[:, 0], pairs[:, 1], b, np.ones(count)), cost


def test_one_answer_alone_is_believed_with_the_probability_of_the_gaussian_integral():
    # One row, standard normal prior: the mean of a half-normal is √(2/π), and (1 - 2e) of it where
    # the other half has a chance of e.
    rows = Constraints(np.array([[2.0, 0.0]]), np.ones(1), np.ones(1), np.zeros(1, dtype=np.int64))
    for e in (0.0, 0.1, 0.3):
        belief = ExpectationPropagation.of(rows, e)
        assert belief.mean == pytest.approx([(1 - 2 * e) * np.sqrt(2 / np.pi), 0.0], abs=1e-2)
        assert belief.predicted == pytest.approx(np.log(0.5))
        assert belief.wrong == pytest.approx([e])


def test_the_samples_are_ordered_as_the_right_answers_say_and_mistakes_are_pointed_out():
    flipped = {3, 17, 31, 40, 52, 58}
    preferences, cost = compared(flipped)
    belief = ExpectationPropagation.of(rows_of(preferences, SHAPE), 0.1)
    values = SHAPE.basis(preferences.samples, preferences.samples) @ belief.mean
    assert np.corrcoef(np.argsort(np.argsort(values)), np.argsort(np.argsort(cost)))[0, 1] > 0.95
    suspects = set(np.flatnonzero(belief.wrong > 0.5).tolist())
    assert len(suspects & flipped) >= 4
    assert len(suspects - flipped) <= 1


def test_ties_teach_nothing_and_without_a_strict_preference_the_prior_stays():
    preferences, _ = compared(set(), count=5)
    ties = Preferences(
        preferences.samples, preferences.first, preferences.second, 0 * preferences.b,
        preferences.weights,
    )  # fmt: skip
    belief = ExpectationPropagation.of(rows_of(ties, SHAPE), 0.1)
    assert not belief.mean.any()
    assert belief.predicted == 0


def test_kpis_that_explain_the_answers_get_weights_of_0_or_more():
    preferences, cost = compared({3, 17})
    columns = np.column_stack([cost / cost.max(), np.random.default_rng(1).random(30)])
    belief = ExpectationPropagation.of(rows_of(preferences, SHAPE, 3.0 * columns), 0.1)
    weights = belief.mean[30:]
    assert np.all(weights > -0.05)
    assert weights[0] > weights[1]
    assert len(belief.wrong) == len(preferences)  # only answers, not the rows of the weights
