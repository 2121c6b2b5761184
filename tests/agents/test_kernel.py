import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents.fitting import Constraints, Learning, fit
from prefcal_agents.kernel import KernelShape
from prefcal_agents.ledger import Preferences
from prefcal_agents.surrogate import Surrogate
from prefcal_env.qp import make_backend


def duels(samples, latent):
    """Every sample against the best one before."""
    values = np.array([latent(z) for z in samples])
    first = np.arange(1, len(samples))
    second = np.array([int(np.argmin(values[:i])) for i in first])
    b = np.sign(values[first] - values[second]).astype(int)
    return Preferences(samples, first, second, b, np.ones(len(b)))


def learned(preferences, shape):
    features = shape.features(preferences.samples)
    constraints = Constraints.of(preferences, features, np.ones(len(preferences)))
    v = fit(constraints, Learning(), make_backend("piqp"))
    return Surrogate(preferences.samples, shape.weights(features, v), shape), v


def test_the_kernel_by_hand_with_the_distance_itself():
    # Distance 2: ε d = 1, φ = 1/2. x = 1 and x' = -3: trend 2 (-3 + 1 · 9) = 12.
    shape = KernelShape(0.5, (1.0,), trend=2.0)
    assert shape.basis(np.array([[1.0]]), np.array([[-1.0]])) == pytest.approx(12.5)


def test_without_a_trend_it_is_the_radial_function_alone():
    shape = KernelShape(0.5, (1.0,), trend=0.0)
    assert shape.basis(np.array([[1.0]]), np.array([[-1.0]])) == pytest.approx(0.5)


@given(
    st.integers(0, 1000), st.integers(1, 5), st.floats(0.1, 20), st.floats(0, 10),
    st.sampled_from(["inverse_quadratic", "gaussian"]),
)  # fmt: skip
def test_it_is_positive_definite_however_close_the_samples_are(seed, n, epsilon, trend, rbf):
    rng = np.random.default_rng(seed)
    samples = rng.random((12, n))
    samples[6:] = samples[:6] + 1e-7 * rng.standard_normal((6, n))
    features = KernelShape(epsilon, (1.0,) * n, trend, rbf).features(samples)
    assert np.isfinite(features).all()
    assert np.all(np.diag(features) > 0)


def test_the_gradient_is_that_of_the_values():
    rng = np.random.default_rng(0)
    centres, beta, z = rng.random((7, 3)), rng.standard_normal(7), rng.random(3)
    surrogate = Surrogate(centres, beta, KernelShape(1.7, (2.0, 0.5, 1.0), 0.8))
    h = 1e-6 * np.eye(3)
    slope = (surrogate(z + h) - surrogate(z - h)) / 2e-6
    assert surrogate.gradient(z) == pytest.approx(slope, abs=1e-6)


def test_the_squared_norm_is_that_of_the_coefficients():
    rng = np.random.default_rng(1)
    samples, v = rng.random((8, 2)), rng.standard_normal(8)
    shape = KernelShape(3.0, (1.0, 1.0))
    features = shape.features(samples)
    beta = shape.weights(features, v)
    phi = shape.basis(samples, samples) + 1e-8 * np.eye(8)
    assert beta @ phi @ beta == pytest.approx(v @ v)
    assert phi @ beta == pytest.approx(features @ v)


def test_it_reproduces_what_was_answered():
    known = duels(np.random.default_rng(2).random((20, 2)), lambda z: np.sin(5 * z[0]) + z[1] ** 2)
    surrogate, _ = learned(known, KernelShape(2.0, (1.0, 1.0)))
    values = surrogate(known.samples)
    assert np.all(known.b * (values[known.first] - values[known.second]) > 0)


def test_no_other_function_that_reproduces_the_answers_has_a_smaller_norm():
    known = duels(np.random.default_rng(3).random((9, 2)), lambda z: z[0] ** 2 + z[1])
    shape = KernelShape(2.0, (1.0, 1.0))
    _, v = learned(known, shape)
    rows = Constraints.of(known, shape.features(known.samples), np.ones(8)).rows
    sigma = Learning().sigma
    for other in v + 0.3 * sigma * np.random.default_rng(4).standard_normal((2000, 9)):
        # Stretched until every margin is kept, if it can be.
        smallest = np.min(rows @ other)
        if smallest > 0:
            assert np.linalg.norm(other) * sigma / smallest >= np.linalg.norm(v) * (1 - 1e-6)


def test_a_strong_trend_finds_the_bottom_of_a_bowl_between_samples_better():
    candidates = np.random.default_rng(6).random((4000, 4))

    def distance(trend):
        total = 0.0
        for seed in range(5, 10):
            samples = np.random.default_rng(seed).random((25, 4))
            known = duels(samples, lambda z: np.sum((z - 0.6) ** 2))
            surrogate, _ = learned(known, KernelShape(5.0, (1.0,) * 4, trend))
            total += np.linalg.norm(candidates[np.argmin(surrogate(candidates))] - 0.6)
        return total / 5

    assert distance(10.0) < 0.9 * distance(0.0)
