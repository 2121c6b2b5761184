"""From the values of the knobs to gains."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.experiments.experiment import Channel
from prefcal_scenarios.cases.loops import LOOPS
from prefcal_scenarios.cases.loops.loop import TunedLQR, TunedPID
from prefcal_scenarios.cases.loops.plants import CartPole, Linear

TWICE = Linear(A=((0.0, 1.0), (0.0, 0.0)), B=((0.0,), (1.0,)), E=((0.0,), (1.0,)))
"""A double integrator."""


def rows(controller, values, n_u=1, T_s=1e-3):
    """The gains for a double integrator at 0, whose inputs rest at 0.5."""
    lag = LOOPS["lag"]()
    inputs = tuple(Channel(f"u{i}", low=-1.0, high=2.0) for i in range(n_u))
    plant = replace(lag.plant, parameters=TWICE, inputs=inputs)
    task = replace(lag.task, x0=np.zeros(2), u0=np.full(n_u, 0.5))
    return controller.make(values, plant, task, T_s).rows


def test_a_pid_has_every_value_in_its_column():
    values = {"K": 2.0, "T_i": 3.0, "T_d": 0.4, "T_f": 0.1, "b": 0.6, "T_t": 1.5}
    row = rows(TunedPID(), values)
    assert row.tolist() == [[2.0, 3.0, 0.4, 0.1, 0.6, 1.5, 0.5, -1.0, 2.0, 0.0, 0.0]]


def test_the_anti_windup_follows_the_integral_time_if_it_is_not_tuned():
    assert rows(TunedPID(), {"K": 1.0, "T_i": 3.0})[0, 5] == 3.0


def test_two_pids_have_their_own_values_and_signs():
    controller = TunedPID(suffixes=("_1", "_2"), signs=(1.0, -1.0), fixed={"b": 0.3})
    found = rows(controller, {"K_1": 2.0, "K_2": 4.0, "T_i": 3.0}, n_u=2)
    assert found[:, 0].tolist() == [2.0, -4.0]
    assert found[:, 1].tolist() == [3.0, 3.0]
    assert found[:, 4].tolist() == [0.3, 0.3]


def test_the_outer_controller_of_a_cascade_has_the_range_of_the_inner_reference():
    cascade = TunedPID(("_outer", "_inner"), inner=(4.0, -20.0, 30.0))
    outer, inner = rows(cascade, {"K_outer": 2.0, "K_inner": 5.0})
    assert outer[[0, 6, 7, 8]].tolist() == [2.0, 4.0, -20.0, 30.0]
    assert inner[[0, 6, 7, 8]].tolist() == [5.0, 0.5, -1.0, 2.0]


def test_the_linearization_of_the_cart_with_a_pole_is_that_of_the_textbook():
    cart = CartPole(cart=1.0, pole=0.2, length=0.5, friction=0.0)
    J = replace(LOOPS["cart-pole"]().plant, parameters=cart).jacobians(np.zeros(4), np.zeros(1), np.zeros(1))
    A, B = J.A, J.B
    assert A[2, 1] == pytest.approx(-0.2 * 9.81, rel=1e-6)  # -m g / M
    assert A[3, 1] == pytest.approx(1.2 * 9.81 / 0.5, rel=1e-6)  # (M + m) g / (M l)
    assert B[:, 0] == pytest.approx([0.0, 0.0, 1.0, -2.0], abs=1e-6)


def test_fast_sampling_gives_the_gains_of_the_continuous_regulator():
    # Without integral action, x1'' = u with weights Q_1 = R = 1 has K = (1, sqrt(2)).
    row = rows(TunedLQR(), {"Q_1": 1.0, "Q_z": 1e-8, "R": 1.0})[0]
    assert row[:2] == pytest.approx([1.0, np.sqrt(2)], rel=0.01)
    assert row[3:].tolist() == [0.5, -1.0, 2.0]


def test_the_closed_loop_of_the_regulator_is_stable_at_any_sampling_time():
    for hold in (10, 500):
        T_s = 1e-3 * hold
        row = rows(TunedLQR(), {"Q_1": 1.0, "Q_z": 1.0, "R": 1.0}, T_s=T_s)[0]
        A = np.array([[1.0, T_s, 0.0], [0.0, 1.0, 0.0], [T_s, T_s**2 / 2, 1.0]])
        B = np.array([T_s**2 / 2, T_s, T_s**3 / 6])
        assert np.abs(np.linalg.eigvals(A - np.outer(B, row[:3]))).max() < 1.0
