"""Interpolation of scores: exact on the samples, and honest about how well it predicts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator
from scipy.optimize import check_grad

from prefcal_agents.baselines import POSITIVE_DEFINITE, best_interpolant, interpolate
from prefcal_agents.lessons import normalized

RNG = np.random.default_rng(7)
SAMPLES = RNG.uniform(-1, 1, (12, 3))
VALUES = np.sin(SAMPLES @ [1.0, 2.0, -1.0])


@pytest.mark.parametrize("rbf", POSITIVE_DEFINITE)
def test_it_goes_through_the_values_and_has_the_right_slope(rbf):
    interpolant, _ = interpolate(SAMPLES, VALUES, 0.8, rbf)
    assert interpolant(SAMPLES) == pytest.approx(VALUES, abs=1e-6)
    z = np.array([0.3, -0.2, 0.7])
    slope = check_grad(lambda x: interpolant(x[None])[0], interpolant.gradient, z)
    assert slope < 1e-5 * max(1.0, np.abs(interpolant.beta).max())


def test_it_agrees_with_scipy():
    interpolant, _ = interpolate(SAMPLES, VALUES, 1.3, "inverse_quadratic")
    reference = RBFInterpolator(
        SAMPLES, VALUES - VALUES.mean(), kernel="inverse_quadratic", epsilon=1.3, degree=-1
    )
    z = RNG.uniform(-1, 1, (20, 3))
    assert interpolant(z) == pytest.approx(reference(z) + VALUES.mean(), abs=1e-6)


def test_the_leave_one_out_error_is_what_leaving_one_out_gives():
    # The mean stays that of all values, as in the formula.
    offset, errors = VALUES.mean(), []
    _, error = interpolate(SAMPLES, VALUES, 1.0, "inverse_quadratic")
    for k in range(len(SAMPLES)):
        rest = np.arange(len(SAMPLES)) != k
        reference = RBFInterpolator(
            SAMPLES[rest], VALUES[rest] - offset, kernel="inverse_quadratic", epsilon=1.0, degree=-1
        )
        errors.append(reference(SAMPLES[k : k + 1])[0] + offset - VALUES[k])
    assert error == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=1e-4)


def test_the_epsilon_that_predicts_best_is_chosen():
    narrow = best_interpolant(SAMPLES, VALUES, (0.5, 50.0), "inverse_quadratic")
    assert narrow.epsilon == 0.5


def test_two_samples_at_one_place_break_nothing():
    samples = np.vstack([SAMPLES, SAMPLES[:1]])
    values = np.append(VALUES, VALUES[0] + 1e-3)
    interpolant, _ = interpolate(samples, values, 1.0, "gaussian")
    assert np.isfinite(interpolant(samples)).all()


@given(st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=30), st.floats(0.01, 100.0))
def test_normalized_scores_keep_their_order(values, ceiling):
    values = np.array(values)
    shares = normalized(values, ceiling)
    assert ((shares >= 0) & (shares <= 1)).all()
    assert shares[np.argmin(values)] == 0
    order = np.argsort(values, kind="stable")
    assert (np.diff(shares[order]) >= 0).all()


def test_an_interrupted_run_does_not_flatten_the_others():
    values = np.array([0.7, 0.8, 0.9, 1.0, 1000.5, 1000.9])
    shares = normalized(values, 2.0)
    assert shares[3] > 0.3
    assert shares[4] == shares[5] == 1.0
    assert normalized(values, 1e9)[3] < 1e-3
