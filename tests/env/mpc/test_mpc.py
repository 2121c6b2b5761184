"""The MPC, its compiled pieces, and the estimators that give it its state."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.cstr import TARGET, cstr_task
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channel, Measurement
from prefcal_env.mpc import (
    DisturbanceEstimator,
    EstimatingMPC,
    EstimatorSettings,
    ExtendedKalmanFilter,
    LinearMPC,
    MPCSettings,
    StateEstimate,
    control_horizon,
)
from prefcal_env.mpc.controller import BACKENDS
from prefcal_env.mpc.kernels import discretize, triangularize
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cstr import CSTR, FEED, CSTRParams
from prefcal_env.plants.function_plant import FunctionPlant
from prefcal_env.plants.plant import Disturbed
from prefcal_env.qp import Tolerances
from support.linear_plant import dense_moves, random_plant

BASE = MPCSettings(T_s=0.3, N_p=9, N_u=4, Q_y=np.eye(2), Q_du=0.1 * np.eye(2))
OPTIONS = {
    "plain": {},
    "input weights and reference": {"Q_u": np.diag([0.5, 0.0]), "u_ref": [0.4, -0.3]},
    "previewed input reference": {"Q_u": np.eye(2), "u_ref": [[0.4, -0.3], [0.0, 1.0]]},
    "move limits": {"du_min": [-0.2, -0.1], "du_max": [0.1, 0.3]},
    "soft outputs": {"y_min": [-0.1, -np.inf], "y_max": [0.1, 0.2], "Q_eps": 50.0},
    "softness": {"y_max": [0.0, 0.0], "softness": [1.0, 0.2], "du_max": [0.3, 0.3]},
    "full weights": {"Q_y": [[2.0, 1.0], [1.0, 1.0]], "Q_du": [[0.3, 0.1], [0.1, 0.2]]},
    "rank-one output weight": {"Q_y": [[1.0, 1.0], [1.0, 1.0]]},
    "one free move": {"N_u": 1},
    "all moves free": {"N_u": 9},
    "horizon of one": {"N_p": 1, "N_u": 1},
}


def measurement(seed, preview=False):
    rng = np.random.default_rng(seed)
    return Measurement(
        0.0,
        rng.normal(size=3),
        rng.uniform(-1, 1.5, size=2),
        rng.normal(size=(4, 1)) if preview else rng.normal(size=1),
        rng.normal(size=(5, 2)) if preview else rng.normal(size=2),
    )


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("linearization", ["point", "trajectory"])
@pytest.mark.parametrize("option", OPTIONS)
def test_first_move_is_that_of_eq_mpc_written_down(option, linearization, backend):
    mpc = replace(BASE, linearization=linearization, backend=backend, **OPTIONS[option])
    for seed in range(4):
        plant, m = random_plant(seed, feedthrough=seed % 2 == 1), measurement(seed, seed > 1)
        move = LinearMPC(plant, mpc).move(m)
        assert move.solved
        np.testing.assert_allclose(move.u, dense_moves(plant, mpc, m)[0], atol=2e-5)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), N_p=st.integers(1, 15), share=st.floats(0.01, 1))
def test_first_move_is_that_of_eq_mpc_for_any_plant_and_horizon(seed, N_p, share):
    plant, m = random_plant(seed), measurement(seed)
    mpc = replace(
        BASE,
        N_p=N_p,
        N_u=max(1, int(share * N_p)),
        du_min=[-0.3] * 2,
        du_max=[0.3] * 2,
        tolerances=Tolerances(absolute=1e-11, relative=1e-11),
    )
    move = LinearMPC(plant, mpc).move(m)
    assert move.solved
    np.testing.assert_allclose(move.u, dense_moves(plant, mpc, m)[0], atol=2e-5)


def test_a_last_input_outside_its_limits_is_led_back_as_fast_as_allowed():
    plant = random_plant(0)
    mpc = replace(BASE, du_min=[-0.2, -0.2], du_max=[0.2, 0.2])
    m = replace(measurement(0), u=np.array([3.0, -4.0]))
    move = LinearMPC(plant, mpc).move(m)
    assert move.solved
    np.testing.assert_allclose(move.u, [2.8, -3.8], atol=1e-9)


def test_the_applied_move_keeps_the_limits_to_the_last_bit():
    mpc = replace(BASE, Q_du=1e-6 * np.eye(2), du_max=[0.1, 0.1], du_min=[-0.1, -0.1])
    for seed in range(20):
        m = measurement(seed)
        u = LinearMPC(random_plant(seed), mpc).move(m).u
        assert np.all(u <= 1.5)
        assert np.all(u >= -1.0)
        assert np.all(np.abs(u - m.u) <= 0.1 + 1e-15)


def test_singular_input_weights_have_a_unique_answer_near_a_small_weight():
    """Deviation in `LinearMPC`: 1e-10 of the largest weight where Q_u + Q_Δu is singular."""
    plant, m = random_plant(3, feedthrough=False), measurement(3)
    none = LinearMPC(plant, replace(BASE, Q_du=np.zeros((2, 2)), N_p=3, N_u=3)).move(m)
    tiny = LinearMPC(plant, replace(BASE, Q_du=1e-9 * np.eye(2), N_p=3, N_u=3)).move(m)
    assert none.solved
    np.testing.assert_allclose(none.u, tiny.u, atol=1e-3)


def test_an_unsolved_qp_holds_the_last_input_and_says_so():
    mpc = replace(BASE, tolerances=Tolerances(max_iterations=1), du_max=[1e-3, 1e-3])
    m = measurement(1)
    move = LinearMPC(random_plant(1), mpc).move(m)
    assert not move.solved
    np.testing.assert_array_equal(move.u, m.u)


def test_soft_limits_far_into_an_unstable_prediction_are_not_called_solved():
    plant = CSTR()
    x, u = np.array([342.15, 5.61]), np.array([304.3])
    settings = MPCSettings(T_s=1.5, N_p=40, N_u=13, Q_y=np.diag([0, 1]), Q_du=[[0.1]], y_max=[380.0, np.inf])
    move = LinearMPC(plant, settings).move(Measurement(0, x, u, FEED, np.array([0.0, 2.0])))
    assert not move.solved


def test_trajectory_linearization_follows_the_last_plan():
    plant = CSTR()
    x, u = plant.steady_state_at_concentration(8.56)
    settings = MPCSettings(
        T_s=0.5, N_p=10, N_u=3, Q_y=np.diag([0, 1]), Q_du=[[0.1]], linearization="trajectory"
    )
    m = Measurement(0, x, u, FEED, np.array([0.0, 2.0]))
    controller = LinearMPC(plant, settings)
    first, second = controller.move(m), controller.move(m)
    assert first.u != second.u  # the second linearizes along what the first planned
    third = controller.move(m)
    assert abs(third.u - second.u) < abs(second.u - first.u)  # and the repetition settles


def test_after_forgetting_it_linearizes_as_a_fresh_one():
    plant, m = random_plant(2), measurement(2)
    mpc = replace(BASE, linearization="trajectory")
    used, fresh = LinearMPC(plant, mpc), LinearMPC(plant, mpc)
    used.move(replace(m, x=m.x + 1.0))
    used.forget()
    np.testing.assert_array_equal(used.move(m).u, fresh.move(m).u)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"N_p": 0}, "N_p must be an integer of 1 or more, got 0"),
        ({"N_p": 2.5}, "N_p must be an integer"),
        ({"N_u": 10}, "N_u must not be above N_p = 9, got 10"),
        ({"T_s": 0.0}, "T_s must be positive"),
        ({"T_s": np.nan}, "T_s must be positive"),
        ({"Q_eps": -1}, "Q_eps must be positive"),
        ({"Q_y": [[1.0, 0.0], [0.0, -1.0]]}, "Q_y must be positive semidefinite"),
        ({"Q_du": [[1.0, 2.0], [0.0, 1.0]]}, "Q_du must be symmetric"),
        ({"Q_u": [[np.nan, 0.0], [0.0, 1.0]]}, "Q_u must be a finite square matrix"),
        ({"u_min": [0, 0], "u_max": [-1, 1]}, "u_min must not be above u_max"),
        ({"N_p": "x"}, "N_p must be an integer"),
        ({"N_p": np.inf}, "N_p must be an integer"),
        ({"T_s": None}, "T_s must be positive"),
        ({"Q_y": None}, "Q_y must be numbers"),
        ({"Q_y": [[1.0], [0.0, 1.0]]}, "Q_y must be numbers"),
        ({"tolerances": 1e-3}, "tolerances must be Tolerances"),
        ({"linearization": "tangent"}, "linearization must be one of"),
        ({"backend": "osqp"}, "backend must be one of"),
    ],
)
def test_impossible_settings_are_refused(change, message):
    with pytest.raises(SettingsError, match=message):
        replace(BASE, **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Q_y": np.eye(3)}, r"Q_y must be a finite square matrix, shape \(2, 2\)"),
        ({"u_ref": [1, 2, 3]}, "u_ref must be finite"),
        ({"y_min": [1]}, "y_min must hold 2 numbers"),
        ({"u_min": [2, 0]}, "u_min must not be above u_max .the plant's"),
        ({"Q_y": np.zeros((2, 2)), "Q_du": np.zeros((2, 2))}, "must not all be zero"),
        ({"du_min": [0.1, -1]}, "an input may always be held"),
        ({"softness": [-1, 1]}, "softness must be 0 or more"),
    ],
)
def test_settings_that_do_not_fit_the_plant_are_refused(change, message):
    with pytest.raises(SettingsError, match=message):
        LinearMPC(random_plant(0), replace(BASE, **change))


def test_settings_are_equal_by_value_and_frozen():
    assert replace(BASE) == BASE
    assert hash(BASE) == hash(replace(BASE))
    with pytest.raises(AttributeError):
        BASE.N_p = 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": np.zeros(2)}, r"x must be an array of shape \(3,\)"),
        ({"x": [0.0, 0.0, 0.0]}, "x must be an array"),
        ({"u": np.zeros(3)}, "u must be an array"),
        ({"d": np.zeros((0, 1))}, "d must be an array of shape .* or one row a step"),
        ({"y_ref": np.zeros(3)}, "y_ref must be an array"),
        ({"y_ref": np.array([0.0, np.nan])}, "y_ref must be finite"),
        ({"x": np.array([0.0, np.inf, 0.0])}, "measurement: x must be finite"),
        ({"x": np.array([0.0, -np.inf, 0.0])}, "x must be finite"),
    ],
)
def test_a_measurement_that_does_not_fit_is_refused(change, message):
    controller = LinearMPC(random_plant(0), BASE)
    with pytest.raises(PlantError, match=message):
        controller.move(replace(measurement(0), **change))


def test_previews_may_be_laid_out_as_they_like():
    plant, m = random_plant(1), measurement(1, preview=True)
    other = replace(m, d=np.asfortranarray(m.d), y_ref=np.asfortranarray(m.y_ref), x=m.x[::1])
    expected = LinearMPC(plant, BASE).move(m)
    np.testing.assert_array_equal(LinearMPC(plant, BASE).move(other).u, expected.u)
    whole = replace(m, d=np.ones((3, 1), dtype=int).T[:, :1], y_ref=np.ones(2, dtype=int))
    floats = replace(whole, d=whole.d.astype(float), y_ref=whole.y_ref.astype(float))
    np.testing.assert_array_equal(LinearMPC(plant, BASE).move(whole).u, LinearMPC(plant, BASE).move(floats).u)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), size=st.floats(0.01, 30), T=st.floats(0.01, 2))
def test_discretize_is_the_matrix_exponential(seed, size, T):
    rng = np.random.default_rng(seed)
    A, B, c = size * rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), rng.normal(size=3)
    M = np.zeros((6, 6))
    M[:3] = np.hstack([A, B, c[:, None]])
    E = expm(M * T)[:3]
    ours = np.hstack([discretize(A, B, c, T)[0], discretize(A, B, c, T)[1]])
    np.testing.assert_allclose(ours, E[:, :5], rtol=1e-9, atol=1e-9 * np.abs(E).max())
    np.testing.assert_allclose(discretize(A, B, c, T)[2], E[:, 5], rtol=1e-9, atol=1e-9 * np.abs(E).max())


def test_an_integrator_of_a_constant_drifts_linearly():
    A_d, B_d, c_d = discretize(np.zeros((1, 1)), np.ones((1, 1)), np.array([3.0]), 0.5)
    assert (A_d[0, 0], B_d[0, 0], c_d[0]) == pytest.approx((1.0, 0.5, 1.5))


@given(seed=st.integers(0, 10**6), rows=st.integers(1, 7), columns=st.integers(1, 6))
def test_triangularize_keeps_the_inner_products(seed, rows, columns):
    M = np.random.default_rng(seed).normal(size=(rows, columns))
    R = M.copy()
    triangularize(R, rows, columns, 0)
    np.testing.assert_allclose(R.T @ R, M.T @ M, atol=1e-10)
    np.testing.assert_array_equal(np.tril(R, -1), 0)


def test_rows_of_very_different_size_keep_their_own_accuracy():
    """Two rows of size 1 beside one of 1e40: plain QR leaves only rounding of the large one."""
    big, a, b = np.array([2e40, 1e40, 3e40]), np.array([1.0, 2, 3]), np.array([0.0, 1.0, 5.0])
    R = np.array([a, big, b])
    triangularize(R, 3, 2, 0)
    # Exactly: with x_1 + x_2 / 2 + 3 / 2 = 0 enforced, rows a and b are 1.5 x_2 + 1.5, x_2 + 5.
    assert np.hypot(1.5, 1.0) == pytest.approx(abs(R[1, 1]), rel=1e-12)
    assert (1.5 * 1.5 + 1.0 * 5.0) / np.hypot(1.5, 1.0) == pytest.approx(
        R[1, 2] * np.sign(R[1, 1]), rel=1e-12
    )
    plain = np.linalg.qr(np.array([a, big, b]), mode="r")
    assert not np.isclose(abs(plain[1, 1]), np.hypot(1.5, 1.0), rtol=1e-3)


@pytest.mark.parametrize(
    ("share", "N_p", "N_u"), [(1 / 3, 4, 1), (1 / 3, 26, 9), (1 / 3, 40, 13), (0.1, 3, 1), (0.5, 5, 3)]
)
def test_control_horizon_rounds_half_up_and_is_at_least_one(share, N_p, N_u):
    assert control_horizon(share, N_p) == N_u


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


def measured_at(x, d=FEED, u=(299.0,)):
    return Measurement(0.0, np.array(x), np.array(u), np.array(d), np.array([320.0, 8.0]))


def test_previewed_disturbances_are_kept_and_each_row_gets_the_estimated_ones():
    estimator = DisturbanceEstimator(CSTR(), OFFSET_FREE, 0.3)
    preview = np.array([FEED, FEED + 1, FEED + 2])
    seen = estimator.see(measured_at([320.0, 8.0], preview))
    assert seen.d.shape == (3, 4)
    np.testing.assert_array_equal(seen.d[:, :2], preview)
    assert np.all(seen.d[:, 2:] == seen.d[0, 2:])


def test_without_disturbances_it_estimates_the_state_alone():
    settings = EstimatorSettings(noise=(0.3, 0.03), process=(1.0, 0.1))
    seen = DisturbanceEstimator(CSTR(), settings, 0.3).see(measured_at([320.0, 8.0]))
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
        estimator.see(measured_at([0.0, 0.0, 0.0], d=(), u=(14.0, 0.0)))


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
