"""IDW: zero on a sample, growing away from all, with the right slopes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import check_grad

from prefcal_agents.baselines import ValueAcquisition, Weights, interpolate
from prefcal_agents.surrogate import squared_distances

RNG = np.random.default_rng(3)
SAMPLES = RNG.uniform(-1, 1, (9, 2))
VALUES = RNG.random(9)


def weights(z):
    return Weights.of(squared_distances(np.atleast_2d(z), SAMPLES))


def test_it_follows_the_published_formulas_one_by_one():
    z = np.array([0.15, -0.4])
    d = np.sum((z - SAMPLES) ** 2, axis=1)
    w = np.exp(-d) / d
    assert weights(z).distance[0] == pytest.approx(2 / np.pi * np.arctan(1 / w.sum()))
    s2 = np.sum(w / w.sum() * (VALUES - 0.3) ** 2)
    assert weights(z).variance(VALUES, np.array([0.3]))[0] == pytest.approx(s2)


def test_both_are_zero_on_a_sample_where_the_value_is_known():
    at = weights(SAMPLES)
    assert np.array_equal(at.distance, np.zeros(9))
    assert at.variance(VALUES, VALUES) == pytest.approx(np.zeros(9), abs=1e-12)


@given(z=st.tuples(st.floats(-1, 1), st.floats(-1, 1)), alpha=st.floats(0, 2), delta=st.floats(0, 2))
def test_the_acquisition_has_the_slope_of_its_values(z, alpha, delta):
    z = np.array(z)
    interpolant, _ = interpolate(SAMPLES, VALUES, 0.7, "inverse_quadratic")
    acquisition = ValueAcquisition(interpolant, VALUES, alpha, delta)
    inside = np.clip((z + 1) / 2, 0.01, 0.99)
    if np.sqrt(squared_distances(2 * inside[None] - 1, SAMPLES).min()) < 0.02:
        return  # s has a kink on every sample
    value, slope = acquisition.value_and_gradient(inside)
    assert value == pytest.approx(acquisition(inside[None])[0])
    error = check_grad(
        lambda x: acquisition(x[None])[0],
        lambda x: acquisition.value_and_gradient(x)[1],
        inside,
        epsilon=1e-7,
    )
    assert error < 1e-3 * (1 + np.abs(slope).max())


def test_next_to_a_sample_nothing_overflows():
    interpolant, _ = interpolate(SAMPLES, VALUES, 0.7, "inverse_quadratic")
    acquisition = ValueAcquisition(interpolant, VALUES, 0.8, 0.5)
    with np.errstate(all="raise", under="ignore"):
        for step in (0.0, 1e-200, 1e-12, 1e-6):
            z = (SAMPLES[:1] + 1) / 2 + step
            assert np.isfinite(acquisition(z)).all()
            assert np.isfinite(acquisition.value_and_gradient(z[0])[1]).all()
