"""The extended Kalman filter, against the linear one and against noise."""

import numpy as np
import pytest

from prefcal_env.errors import SettingsError
from prefcal_env.mpc import Estimate, ExtendedKalmanFilter
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cstr import CSTR, FEED
from prefcal_env.plants.disturbed import Disturbed
from support.linear_plant import random_plant

T_S = 0.3


def covariance(rng, n):
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def test_on_a_linear_plant_it_is_the_kalman_filter():
    rng, plant = np.random.default_rng(1), random_plant(1)
    Q, R, P = covariance(rng, 3), covariance(rng, 2), covariance(rng, 3)
    x, u, d = rng.normal(size=3), rng.normal(size=2), rng.normal(size=1)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=Q, R=R)
    found = Estimate(x, P)
    transition = plant._hold(T_S)
    F = transition[:, :3]
    for _ in range(5):
        y = rng.normal(size=2)
        found = ekf.update(ekf.predict(found, u, d), y, u, d)
        x, P = transition @ np.concatenate([x, u, d]), F @ P @ F.T + Q
        # In the form of information, which shares nothing with that of Joseph.
        information = np.linalg.inv(P) + plant.C.T @ np.linalg.inv(R) @ plant.C
        gained = plant.C.T @ np.linalg.inv(R) @ (y - plant.D @ u)
        x = np.linalg.solve(information, np.linalg.solve(P, x) + gained)
        P = np.linalg.inv(information)
        np.testing.assert_allclose(found.mean, x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.covariance, P, rtol=1e-9, atol=1e-9)


def test_the_mean_is_predicted_by_the_hold_of_the_plant():
    plant = CSTR()
    x, u = plant.steady_state_at_concentration(5.0)
    x = x + np.array([3.0, 0.5])
    ekf = ExtendedKalmanFilter(plant, T_S, Q=np.eye(2), R=np.eye(2))
    predicted = ekf.predict(Estimate(x, np.eye(2)), u, FEED)
    np.testing.assert_allclose(predicted.mean, plant.hold(x, u, FEED, np.array([T_S]))[0], 1e-8)


def test_the_covariance_follows_the_derivative_of_the_hold():
    plant, h = CSTR(), 1e-5
    x, u = plant.steady_state_at_concentration(5.0)
    period = np.array([T_S])
    steps = [h * row for row in np.eye(2)]
    up, down = ([plant.hold(x + sign * e, u, FEED, period)[0] for e in steps] for sign in (1, -1))
    F = (np.array(up) - np.array(down)).T / (2 * h)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=np.zeros((2, 2)), R=np.eye(2))
    predicted = ekf.predict(Estimate(x, np.diag([1.0, 0.01])), u, FEED)
    np.testing.assert_allclose(predicted.covariance, F @ np.diag([1.0, 0.01]) @ F.T, rtol=0.02)


def test_the_model_of_a_disturbed_plant_has_the_derivatives_of_its_disturbances():
    rng, plain = np.random.default_rng(3), random_plant(3)
    plant = Disturbed(plain, on_outputs=(1,), on_inputs=(0,))
    x, u, d = rng.normal(size=5), rng.normal(size=2), rng.normal(size=1)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=np.eye(5), R=np.eye(2))
    A, C = ekf.linearized(Estimate(x, np.eye(5)), u, d)
    for i, e in enumerate(1e-6 * np.eye(5)):
        up, down = ((x[:3] + s * e[:3], u, np.concatenate([d, x[3:] + s * e[3:]])) for s in (1, -1))
        np.testing.assert_allclose(A[:3, i], (plant.f(*up) - plant.f(*down)) / 2e-6, atol=1e-7)
        np.testing.assert_allclose(C[:, i], (plant.g(*up) - plant.g(*down)) / 2e-6, atol=1e-7)
    np.testing.assert_array_equal(A[3:], 0)


def test_disturbances_stay_as_they_are_while_the_state_moves():
    plant = Disturbed(Bicycle(), on_outputs=(2,), on_inputs=(0,))
    ekf = ExtendedKalmanFilter(plant, 0.5, Q=np.eye(5), R=np.eye(3))
    before = Estimate(np.array([0.0, 0.0, 0.0, 0.1, -1.0]), np.eye(5))
    after = ekf.predict(before, np.array([14.0, 0.0]), np.zeros(0))
    np.testing.assert_allclose(after.mean, [6.5, 0, 0, 0.1, -1.0], atol=1e-12)


def test_the_covariance_stays_symmetric_and_positive_over_a_thousand_updates():
    rng, plant = np.random.default_rng(0), CSTR()
    x, u = plant.steady_state_at_concentration(8.56)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=1e-12 * np.eye(2), R=1e-10 * np.eye(2))
    estimate = Estimate(x, 1e6 * np.eye(2))
    for _ in range(1000):
        y = x + 1e-5 * rng.normal(size=2)
        estimate = ekf.update(ekf.predict(estimate, u, FEED), y, u, FEED)
        np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
        assert np.linalg.eigvalsh(estimate.covariance)[0] > 0


def test_an_estimate_is_frozen():
    estimate = Estimate(np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match="read-only"):
        estimate.mean[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        estimate.covariance[0, 0] = 2.0


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"T_s": 0.0}, "T_s must be positive"),
        ({"Q": np.eye(2)}, r"Q must be a finite square matrix, shape \(3, 3\)"),
        ({"Q": np.triu(np.ones((3, 3)))}, "Q must be symmetric"),
        ({"Q": -np.eye(3)}, "Q must be positive semidefinite"),
        ({"R": np.zeros((2, 2))}, "R must be positive definite"),
        ({"R": np.full((2, 2), np.nan)}, "R must be a finite square matrix"),
    ],
)
def test_impossible_settings_are_refused(changes, match):
    asked = {"T_s": T_S, "Q": np.eye(3), "R": np.eye(2)} | changes
    with pytest.raises(SettingsError, match=match):
        ExtendedKalmanFilter(random_plant(0), **asked)


def test_an_estimate_whose_shapes_do_not_fit_is_refused():
    with pytest.raises(SettingsError, match="covariance of shape"):
        Estimate(np.zeros(2), np.eye(3))


def test_it_knows_the_reactor_better_than_its_measurements():
    rng, plant, noise = np.random.default_rng(2), CSTR(), np.array([0.5, 0.05])
    x, u = plant.steady_state_at_concentration(8.56)
    Q = np.diag([0.02, 0.002]) ** 2
    ekf = ExtendedKalmanFilter(plant, T_S, Q=Q, R=np.diag(noise**2))
    estimate, errors = Estimate(x + noise, np.diag(noise**2)), []
    for T_c in rng.uniform(295, 301, size=200):
        u = np.array([T_c])
        x = plant.hold(x, u, FEED, np.array([T_S]))[0]
        y = x + noise * rng.standard_normal(2)
        estimate = ekf.update(ekf.predict(estimate, u, FEED), y, u, FEED)
        errors.append((estimate.mean - x, y - x))
    of_estimate, of_measurement = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(of_estimate < 0.5 * of_measurement)
