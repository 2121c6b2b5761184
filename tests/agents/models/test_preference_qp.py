import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from prefcal_agents.lessons import Preferences
from prefcal_agents.surrogate import Constraints, Learning, Shape, Surrogate, fit, margins


def comparisons(n_samples=9, count=10, seed=0, ties=True, weights=None):
    """Random comparisons, not consistent with any function if there are many."""
    rng = np.random.default_rng(seed)
    pairs = np.array([rng.choice(n_samples, 2, replace=False) for _ in range(count)])
    return Preferences(
        samples=rng.random((n_samples, 2)),
        first=pairs[:, 0],
        second=pairs[:, 1],
        b=rng.choice([-1, 0, 1] if ties else [-1, 1], count),
        weights=np.ones(count) if weights is None else weights,
    )


def basis(preferences, epsilon=1.5):
    return Shape(epsilon, (1.0, 1.0)).basis(preferences.samples, preferences.samples)


def weights_of(preferences, learning):
    phi = basis(preferences)
    constraints = Constraints.of(preferences, phi, margins(preferences, learning.margin_power))
    return fit(constraints, learning)


def cost(beta, preferences, learning):
    """The objective of eq. QP-pref, with each slack as small as eq. RBF-pref allows."""
    values = basis(preferences) @ beta
    gap = values[preferences.first] - values[preferences.second]
    violation = np.where(
        preferences.b == 0, np.abs(gap) - learning.sigma, learning.sigma - preferences.b * gap
    )
    slack = np.maximum(violation, 0)
    return preferences.weights @ slack + learning.lam / 2 * beta @ beta


@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 20),
    sigma=st.sampled_from([1e-6, 1e-2, 1.0]),
    lam_sigma=st.sampled_from([1e-6, 1e-3, 1.0]),
)
@settings(max_examples=25, deadline=None)
def test_no_other_weights_cost_less_in_eq_qp_pref(seed, count, sigma, lam_sigma):
    rng = np.random.default_rng(seed)
    preferences = comparisons(count=count, seed=seed, weights=rng.uniform(0.5, 2, count))
    learning = Learning(sigma=sigma, lam=lam_sigma / sigma)
    beta = weights_of(preferences, learning)
    least = cost(beta, preferences, learning)
    size = np.linalg.norm(beta) + sigma
    for step in (1e-3, 1e-2, 0.1, 1.0):
        for direction in rng.standard_normal((20, len(beta))):
            other = cost(beta + step * size * direction, preferences, learning)
            assert other >= least - 1e-6 * least - 1e-9 * sigma * count


def test_weights_agree_with_a_general_solver():
    preferences, learning = comparisons(count=6, seed=4), Learning(sigma=0.5, lam=0.1)
    n, m = 9, len(preferences)
    phi = basis(preferences)
    difference = phi[preferences.first] - phi[preferences.second]
    b, sigma = preferences.b, learning.sigma
    rows = [(b != 0, b[:, None] * difference, -sigma)]
    rows += [(b == 0, sign * difference, sigma) for sign in (1, -1)]
    limits = [
        {"type": "ineq", "fun": lambda z, k=k, a=a, s=s: (a @ z[:n] + z[n:] + s)[k]} for k, a, s in rows
    ]
    primal = minimize(
        lambda z: preferences.weights @ z[n:] + learning.lam / 2 * z[:n] @ z[:n],
        np.full(n + m, 0.5),
        constraints=limits,
        bounds=[(None, None)] * n + [(0, None)] * m,
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert primal.success
    assert weights_of(preferences, learning) == pytest.approx(primal.x[:n], abs=1e-4)


def test_consistent_preferences_are_reproduced_with_the_paper_s_sigma():
    rng = np.random.default_rng(1)
    samples = rng.random((12, 2))
    values = np.sum((samples - 0.4) ** 2, axis=1)
    values[7] = values[3]
    first, second = np.arange(1, 12), np.arange(11)
    first, second = np.append(first, 7), np.append(second, 3)
    b = np.sign(values[first] - values[second]).astype(int)
    preferences = Preferences(samples, first, second, b, np.ones(12))
    beta = weights_of(preferences, Learning(sigma=1e-6, lam=1.0))
    learned = Surrogate(samples, beta, Shape(1.5, (1.0, 1.0)))(samples)
    gap = (learned[first] - learned[second]) / 1e-6
    strict = b != 0
    assert np.all(b[strict] * gap[strict] >= 1 - 1e-4)
    assert np.all(np.abs(gap[~strict]) <= 1 + 1e-4)


def test_sigma_only_scales_the_weights_if_lambda_sigma_stays():
    preferences = comparisons(count=8, seed=2)
    small = weights_of(preferences, Learning(sigma=1e-6, lam=1.0))
    large = weights_of(preferences, Learning(sigma=1.0, lam=1e-6))
    assert small * 1e6 == pytest.approx(large, rel=1e-6, abs=1e-9)


def test_of_two_contradicting_answers_the_stronger_one_is_believed():
    samples = np.array([[0.0, 0.0], [1.0, 1.0]])
    twice = np.array([0, 0])
    for weights, sign in (((1.0, 3.0), 1), ((3.0, 1.0), -1)):
        preferences = Preferences(samples, twice, twice + 1, np.array([-1, 1]), np.array(weights))
        beta = weights_of(preferences, Learning(sigma=1e-6, lam=1.0))
        learned = Surrogate(samples, beta, Shape(1.5, (1.0, 1.0)))(samples)
        assert np.sign(learned[0] - learned[1]) == sign


def test_nothing_known_and_nothing_but_ties_give_a_flat_surrogate():
    nothing = comparisons(count=1).subset(np.array([], dtype=int))
    assert not weights_of(nothing, Learning()).any()
    preferences = comparisons(count=6)
    ties = Preferences(
        preferences.samples, preferences.first, preferences.second, np.zeros(6, int), np.ones(6)
    )
    assert weights_of(ties, Learning()) == pytest.approx(np.zeros(9), abs=1e-9)


def test_margins_are_sigma_for_all_with_power_zero_and_grow_with_distance_otherwise():
    samples = np.array([[0.0, 0.0], [0.03, 0.03], [0.3, 0.3], [1.0, 1.0]])
    preferences = Preferences(samples, np.array([1, 2, 3]), np.zeros(3, int), np.ones(3, int), np.ones(3))
    assert margins(preferences, 0.0).tolist() == [1, 1, 1]
    assert margins(preferences, 1.0) == pytest.approx([0.1, 1, 1])
    assert margins(preferences, 2.0) == pytest.approx([0.01, 1, 1])


def test_samples_that_phi_cannot_tell_apart_do_no_harm():
    samples = np.array([[0.5, 0.5], [0.5, 0.5 + 1e-13], [0.1, 0.9]])
    preferences = Preferences(samples, np.array([1, 2]), np.array([0, 0]), np.array([-1, 1]), np.ones(2))
    assert np.isfinite(weights_of(preferences, Learning())).all()
