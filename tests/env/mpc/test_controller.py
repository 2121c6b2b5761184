"""The MPC solves eq. MPC as it stands, whatever is in it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Measurement
from prefcal_env.mpc import LinearMPC, MPCSettings
from prefcal_env.mpc.controller import BACKENDS
from prefcal_env.plants.cstr import CSTR, FEED
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
