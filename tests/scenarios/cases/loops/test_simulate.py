"""The compiled simulation: the plant, the dead time, the limits and the control laws."""

import numpy as np
import pytest

from prefcal_scenarios.cases.loops.plants import FEEDBACK, PID, Linear, packed, simulate

LAG = Linear(A=((-1.0,),), B=((2.0,),), E=((1.0,),))
"""ẋ = -x + 2 u + d, in seconds."""
WIDE = np.array([[-100.0, 100.0]])


def pid(K=0.0, T_i=np.inf, T_d=0.0, T_f=0.0, b=1.0, T_t=np.inf, bias=0.0, low=-10.0, high=10.0):
    return np.array([[K, T_i, T_d, T_f, b, T_t, bias, low, high, 0.0, 0.0]])


def run(gains, *, target=1.0, d=0.0, noise=None, delay=0, hold=1, limits=WIDE, law=PID, T=10.0):
    dt = 0.01
    count = round(T / dt) + 1
    return simulate(
        (*packed(LAG), np.array([0])),
        (law, gains, np.zeros((0, 4)), np.zeros(0)),
        (
            np.full((count, 1), target),
            np.full((count, 1), d),
            np.zeros((count, 1)) if noise is None else noise,
        ),
        (dt, hold, delay),
        (np.zeros(1), np.zeros(1), limits),
    )


def test_a_constant_input_gives_the_exact_step_response():
    x, u, valid = run(pid(bias=0.5))
    assert valid == len(x) == 1001
    assert (u == 0.5).all()
    t = 0.01 * np.arange(1001)
    np.testing.assert_allclose(x[:, 0], 1 - np.exp(-t), atol=1e-9)


def test_the_input_acts_after_the_dead_time():
    at_once, late = run(pid(bias=0.5))[0], run(pid(bias=0.5), delay=50)[0]
    assert not late[:51].any()
    np.testing.assert_allclose(late[50:], at_once[:-50], atol=1e-12)


def test_proportional_control_ends_where_the_formula_says():
    x, _, _ = run(pid(K=2.0))
    assert x[-1, 0] == pytest.approx(4 / 5)  # 2 K / (1 + 2 K) of the target


def test_integral_action_removes_the_error_in_spite_of_a_disturbance():
    x, u, _ = run(pid(K=2.0, T_i=0.5), d=0.6)
    assert x[-1, 0] == pytest.approx(1.0, abs=1e-4)
    assert u[-1, 0] == pytest.approx(0.2, abs=1e-4)  # 2 u + d = 1


def test_the_input_is_held_between_sampling_instants_and_limited():
    _, u, _ = run(pid(K=5.0, high=0.8), hold=20)
    assert u.max() == 0.8
    assert (np.diff(u[:, 0]).nonzero()[0] % 20 == 19).all()


def test_the_set_point_weight_scales_the_first_move():
    assert run(pid(K=2.0, T_i=1.0, b=0.25))[1][0, 0] == pytest.approx(0.5)


def test_the_anti_windup_shortens_the_overshoot():
    def peak(T_t):
        return run(pid(K=1.0, T_i=0.1, T_t=T_t, high=0.6))[0].max()

    assert peak(0.05) < peak(np.inf) - 0.05


def test_the_filter_calms_the_input():
    noise = 0.1 * np.random.default_rng(0).standard_normal((1001, 1))

    def moves(T_f):
        return np.diff(run(pid(K=2.0, T_d=0.05, T_f=T_f), noise=noise)[1], axis=0).std()

    assert moves(0.2) < moves(0.01) / 10


def test_state_feedback_integrates_the_error_away():
    gains = np.array([[1.0, 2.0, 0.0, -10.0, 10.0]])  # K, K_z, bias, low, high
    x, _, _ = run(gains, law=FEEDBACK, d=0.6)
    assert x[-1, 0] == pytest.approx(1.0, abs=1e-3)


def test_stages_with_hysteresis_switch_less():
    noise = 0.02 * np.random.default_rng(0).standard_normal((1001, 1))

    def switches(hysteresis):
        gains = pid(K=4.0, T_i=1.0, low=0.0, high=1.0)
        gains[0, -2:] = 4.0, hysteresis
        u = run(gains, noise=noise)[1]
        assert set(np.unique(u)) <= {0.0, 0.25, 0.5, 0.75, 1.0}
        return np.count_nonzero(np.diff(u[:, 0]))

    assert 0 < switches(0.5) < switches(0.0) / 2


def test_it_stops_after_the_first_state_outside_its_limits():
    x, u, valid = run(pid(bias=1.0), limits=np.array([[-1.0, 1.0]]))
    assert valid == 71  # 2 (1 - exp(-t)) passes 1 at t = ln 2
    assert x[valid - 2, 0] <= 1.0 < x[valid - 1, 0]
    assert u[valid - 1, 0] == 1.0
