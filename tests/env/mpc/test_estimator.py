"""The extended Kalman filter and what estimates disturbances with it: no offset, less noise."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.cstr import TARGET, cstr_task
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel, Measurement
from prefcal_env.mpc import (
    DisturbanceEstimator,
    EstimatingMPC,
    EstimatorSettings,
    ExtendedKalmanFilter,
    LinearMPC,
    MPCSettings,
    StateEstimate,
)
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cstr import CSTR, FEED, CSTRParams
from prefcal_env.plants.function_plant import FunctionPlant
from prefcal_env.plants.plant import Disturbed
from support.linear_plant import random_plant

T_S = 0.3
MPC = MPCSettings(
    T_s=0.31, N_p=26, N_u=9, Q_y=[[0, 0], [0, 1]], Q_du=[[10**-1.79]], du_min=[-10.0], du_max=[10.0]
)
OFFSET_FREE = EstimatorSettings(noise=(0.3, 0.03), process=(0.1, 0.01), drift=(0.1, 0.01), on_outputs=(0, 1))
REACTORS = {
    "faster reaction": CSTRParams(k_0=1.05 * 3.49e7),
    "better cooling": CSTRParams(US_V=1.05 * 150),
    "worse cooling": CSTRParams(US_V=0.95 * 150),
}
THETA = np.zeros(1)  # for the record alone


def covariance(rng, n):
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def test_on_a_linear_plant_it_is_the_kalman_filter():
    rng, plant = np.random.default_rng(1), random_plant(1)
    Q, R, P = covariance(rng, 3), covariance(rng, 2), covariance(rng, 3)
    x, u, d = rng.normal(size=3), rng.normal(size=2), rng.normal(size=1)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=Q, R=R)
    found = StateEstimate(x, P)
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
    predicted = ekf.predict(StateEstimate(x, np.eye(2)), u, FEED)
    np.testing.assert_allclose(predicted.mean, plant.hold(x, u, FEED, np.array([T_S]))[0], 1e-8)


def test_it_knows_the_reactor_better_than_its_measurements():
    rng, plant, noise = np.random.default_rng(2), CSTR(), np.array([0.5, 0.05])
    x, u = plant.steady_state_at_concentration(8.56)
    Q = np.diag([0.02, 0.002]) ** 2
    ekf = ExtendedKalmanFilter(plant, T_S, Q=Q, R=np.diag(noise**2))
    estimate, errors = StateEstimate(x + noise, np.diag(noise**2)), []
    for T_c in rng.uniform(295, 301, size=200):
        u = np.array([T_c])
        x = plant.hold(x, u, FEED, np.array([T_S]))[0]
        y = x + noise * rng.standard_normal(2)
        estimate = ekf.update(ekf.predict(estimate, u, FEED), y, u, FEED)
        errors.append((estimate.mean - x, y - x))
    of_estimate, of_measurement = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(of_estimate < 0.5 * of_measurement)


def test_the_covariance_follows_the_derivative_of_the_hold():
    plant, h = CSTR(), 1e-5
    x, u = plant.steady_state_at_concentration(5.0)
    period = np.array([T_S])
    steps = [h * row for row in np.eye(2)]
    up, down = ([plant.hold(x + sign * e, u, FEED, period)[0] for e in steps] for sign in (1, -1))
    F = (np.array(up) - np.array(down)).T / (2 * h)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=np.zeros((2, 2)), R=np.eye(2))
    predicted = ekf.predict(StateEstimate(x, np.diag([1.0, 0.01])), u, FEED)
    np.testing.assert_allclose(predicted.covariance, F @ np.diag([1.0, 0.01]) @ F.T, rtol=0.02)


def test_the_model_of_a_disturbed_plant_has_the_derivatives_of_its_disturbances():
    rng, plain = np.random.default_rng(3), random_plant(3)
    plant = Disturbed(plain, on_outputs=(1,), on_inputs=(0,))
    x, u, d = rng.normal(size=5), rng.normal(size=2), rng.normal(size=1)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=np.eye(5), R=np.eye(2))
    A, C = ekf.linearized(StateEstimate(x, np.eye(5)), u, d)
    for i, e in enumerate(1e-6 * np.eye(5)):
        up, down = ((x[:3] + s * e[:3], u, np.concatenate([d, x[3:] + s * e[3:]])) for s in (1, -1))
        np.testing.assert_allclose(A[:3, i], (plant.f(*up) - plant.f(*down)) / 2e-6, atol=1e-7)
        np.testing.assert_allclose(C[:, i], (plant.g(*up) - plant.g(*down)) / 2e-6, atol=1e-7)
    np.testing.assert_array_equal(A[3:], 0)


def test_disturbances_stay_as_they_are_while_the_state_moves():
    plant = Disturbed(Bicycle(), on_outputs=(2,), on_inputs=(0,))
    ekf = ExtendedKalmanFilter(plant, 0.5, Q=np.eye(5), R=np.eye(3))
    before = StateEstimate(np.array([0.0, 0.0, 0.0, 0.1, -1.0]), np.eye(5))
    after = ekf.predict(before, np.array([14.0, 0.0]), np.zeros(0))
    np.testing.assert_allclose(after.mean, [6.5, 0, 0, 0.1, -1.0], atol=1e-12)


def test_the_covariance_stays_symmetric_and_positive_over_a_thousand_updates():
    rng, plant = np.random.default_rng(0), CSTR()
    x, u = plant.steady_state_at_concentration(8.56)
    ekf = ExtendedKalmanFilter(plant, T_S, Q=1e-12 * np.eye(2), R=1e-10 * np.eye(2))
    estimate = StateEstimate(x, 1e6 * np.eye(2))
    for _ in range(1000):
        y = x + 1e-5 * rng.normal(size=2)
        estimate = ekf.update(ekf.predict(estimate, u, FEED), y, u, FEED)
        np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
        assert np.linalg.eigvalsh(estimate.covariance)[0] > 0


def test_an_estimate_is_frozen():
    estimate = StateEstimate(np.zeros(2), np.eye(2))
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
def test_an_impossible_filter_is_refused(changes, match):
    asked = {"T_s": T_S, "Q": np.eye(3), "R": np.eye(2)} | changes
    with pytest.raises(SettingsError, match=match):
        ExtendedKalmanFilter(random_plant(0), **asked)


def test_an_estimate_whose_shapes_do_not_fit_is_refused():
    with pytest.raises(SettingsError, match="covariance of shape"):
        StateEstimate(np.zeros(2), np.eye(3))


def at_rest(controller, params, horizon=48.0):
    """The run of 48 h that does not stop where it has settled."""
    plant = CSTR(params)
    task = replace(cstr_task(plant), settled=lambda step: False, horizon=horizon)
    return rollout(PlantEnv(plant, task), controller, THETA)


@pytest.mark.parametrize("name", REACTORS)
def test_where_the_model_is_wrong_it_has_no_offset_and_the_plain_mpc_has_one(name):
    plain = at_rest(LinearMPC(CSTR(), MPC), REACTORS[name])
    free = at_rest(EstimatingMPC(CSTR(), MPC, OFFSET_FREE), REACTORS[name])
    assert abs(plain.x[-1, 1] - TARGET) > 0.05
    assert free.x[-1, 1] == pytest.approx(TARGET, abs=0.005)
    assert free.solved.all()


def test_where_the_model_is_right_it_decides_as_the_plain_mpc():
    plain, free = (
        at_rest(c, CSTRParams()) for c in (LinearMPC(CSTR(), MPC), EstimatingMPC(CSTR(), MPC, OFFSET_FREE))
    )
    np.testing.assert_allclose(free.u_control, plain.u_control, atol=1e-3)


def test_output_limits_hold_for_the_outputs_as_they_are_not_as_the_model_has_them():
    limited = replace(MPC, y_min=[-np.inf, 2.5], y_max=[np.inf, np.inf], Q_eps=1e6)
    free = at_rest(EstimatingMPC(CSTR(), limited, OFFSET_FREE), REACTORS["faster reaction"])
    plain = at_rest(LinearMPC(CSTR(), limited), REACTORS["faster reaction"])
    assert free.x[-1, 1] == pytest.approx(2.5, abs=0.005)
    assert plain.x[-1, 1] < 2.49


def noisy_run(controller, noise, steps=150, seed=0):
    """True and measured states at the sampling instants, each (steps, 2), and the estimates."""
    rng, plant = np.random.default_rng(seed), CSTR()
    task = cstr_task(plant)
    x, u = task.x0, task.u0
    true, measured, estimated = [], [], []
    for k in range(steps):
        y = x + noise * rng.standard_normal(2)
        u = controller.move(Measurement(k * MPC.T_s, y, u, FEED, task.reference(0.0))).u
        outputs = controller.estimator.estimate.mean
        true.append(x), measured.append(y), estimated.append(outputs[:2] + outputs[2:])
        x = plant.hold(x, u, FEED, np.array([MPC.T_s]))[0]
    return np.array(true), np.array(measured), np.array(estimated)


def test_with_noise_the_estimated_outputs_are_better_than_the_measured_ones():
    noise = np.array([0.3, 0.03])
    x, y, estimated = noisy_run(EstimatingMPC(CSTR(), MPC, OFFSET_FREE), noise)
    of_estimate = np.sqrt(np.mean((estimated - x) ** 2, axis=0))
    assert np.all(of_estimate < 0.6 * np.sqrt(np.mean((y - x) ** 2, axis=0)))
    assert x[-1, 1] == pytest.approx(TARGET, abs=0.1)


def measurement(x, d=FEED, u=(299.0,)):
    return Measurement(0.0, np.array(x), np.array(u), np.array(d), np.array([320.0, 8.0]))


def test_previewed_disturbances_are_kept_and_each_row_gets_the_estimated_ones():
    estimator = DisturbanceEstimator(CSTR(), OFFSET_FREE, 0.3)
    preview = np.array([FEED, FEED + 1, FEED + 2])
    seen = estimator.see(measurement([320.0, 8.0], preview))
    assert seen.d.shape == (3, 4)
    np.testing.assert_array_equal(seen.d[:, :2], preview)
    assert np.all(seen.d[:, 2:] == seen.d[0, 2:])


def test_without_disturbances_it_estimates_the_state_alone():
    settings = EstimatorSettings(noise=(0.3, 0.03), process=(1.0, 0.1))
    seen = DisturbanceEstimator(CSTR(), settings, 0.3).see(measurement([320.0, 8.0]))
    np.testing.assert_array_equal(seen.d, FEED)
    np.testing.assert_allclose(seen.x, [320.0, 8.0])


def test_an_estimate_that_is_not_finite_is_given_up_for_what_is_measured():
    escaping = FunctionPlant(
        lambda x, u, d: x**2 + u, states=[Channel("x")], inputs=[Channel("u", low=-1.0, high=1.0)]
    )
    settings = EstimatorSettings(noise=(0.1,), process=(0.1,), drift=(0.1,), on_outputs=(0,))
    estimator = DisturbanceEstimator(escaping, settings, 1.0)
    estimator.see(Measurement(0.0, np.array([10.0]), np.zeros(1), np.zeros(0), np.zeros(1)))
    with np.errstate(all="ignore"):
        seen = estimator.see(Measurement(1.0, np.array([0.5]), np.zeros(1), np.zeros(0), np.zeros(1)))
    np.testing.assert_array_equal(seen.x, [0.5])
    np.testing.assert_array_equal(seen.d, [0.0])


def test_a_position_that_is_off_cannot_be_told_from_one_that_is_not():
    settings = EstimatorSettings(noise=(0.1,) * 3, process=(0.1,) * 3, drift=(0.1,), on_outputs=(1,))
    estimator = DisturbanceEstimator(Bicycle(), settings, 0.1)
    with pytest.raises(SettingsError, match="cannot be distinguished from the state of 'bicycle'"):
        estimator.see(measurement([0.0, 0.0, 0.0], d=(), u=(14.0, 0.0)))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"noise": (0.3,)}, "noise must hold 2 numbers"),
        ({"noise": (0.3, 0.0)}, "noise must be finite and above 0"),
        ({"process": (1.0, -1.0)}, "process must be finite and at least 0"),
        ({"drift": (1.0,)}, "drift must hold 2 numbers"),
        ({"start": (1.0, 1.0, 1.0)}, "start must hold 2 numbers"),
        ({"on_outputs": (0, 2)}, "on_outputs must be different indices below 2"),
        ({"on_inputs": (0,)}, "3 disturbances are too many for 2 outputs"),
    ],
)
def test_an_impossible_estimator_is_refused(changes, match):
    with pytest.raises(SettingsError, match=match):
        EstimatingMPC(CSTR(), MPC, replace(OFFSET_FREE, **changes))
