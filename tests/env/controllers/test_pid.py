"""The PID as it runs, and the sampled law that it follows in linear loops."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from prefcal_env import PID, Channel, Measurement, Plant, PlantEnv, Task, rollout
from prefcal_env.controllers import as_data, from_data
from prefcal_env.controllers.margins import sampled
from prefcal_env.controllers.pid import Decentralized, LinearPIDs, PIDLaw, Tuning, migo
from prefcal_env.errors import SettingsError
from prefcal_env.plants.systems import system_of


def seen(y, *, r=0.0, u=0.0):
    values = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (u, [], r, y))
    u, d, r, y = values
    return Measurement(0.0, y, u, d, r, y)


def closed(pid, *, limits=(-100.0, 100.0), horizon=60.0, y_ref=1.0):
    plant = Plant.of(([1.0], [5.0, 1.0]), inputs=[Channel("u", "", *limits)], outputs=["y"])
    reference = y_ref if callable(y_ref) else np.array([y_ref])
    task = Task(np.zeros(1), np.zeros(1), reference, horizon, dense_step=pid.T_s)
    return rollout(PlantEnv(plant, task), pid, np.ones(1))


def test_a_cancelled_lag_answers_a_step_like_a_first_order_lag():
    # K_p (1 + 1/(T_i s)) / (5 s + 1) with T_i = 5 is K_p / (5 s): a closed loop with lag 5 / K_p.
    e = closed(PID(2.0, 5.0, T_s=0.01), horizon=10.0)
    assert e.output(0) == pytest.approx(1 - np.exp(-e.t / 2.5), abs=5e-3)


def test_proportional_action_alone_leaves_the_known_error():
    assert closed(PID(4.0, T_s=0.1)).output(0)[-1] == pytest.approx(0.8, abs=1e-6)


def test_a_long_saturation_does_not_wind_the_integral_up():
    def late(t):
        return np.array([5.0 if t < 30 else 0.5])  # 5 is out of reach: the input ends at 1

    e = closed(PID(2.0, 5.0, T_s=0.1), limits=(-1.0, 1.0), y_ref=late)
    down = e.t_control >= 30.0
    assert e.u_control[np.flatnonzero(down)[0], 0] < 1.0
    assert e.output(0)[-1] == pytest.approx(0.5, abs=0.01)
    assert e.output(0)[e.t > 30].min() > 0.3


def test_the_first_move_at_rest_is_the_last_input():
    pid = PID(3.0, 4.0, 1.0, T_s=0.1)
    assert pid.move(seen(2.0, r=2.0, u=7.0)).u == pytest.approx(7.0)


def test_a_step_from_numbers_is_the_move_and_starts_where_the_input_is():
    pid, other = (PID(2.0, 5.0, 1.0, T_s=0.1, low=1.0, high=3.0) for _ in range(2))
    u = 1.0  # the limit that is nearest to 0
    for y, r in [(0.0, 0.5), (0.2, 0.5), (0.3, np.nan), (0.6, 0.5), (0.4, 9.0), (0.5, 0.5), (0.5, 0.4)]:
        u = float(other.move(seen(y, r=r, u=u)).u[0])
        assert pid.step(r, y) == u
        assert 1.0 <= u <= 3.0
    # What acted was something else: the integral follows it.
    alone = deepcopy(pid)
    assert pid.step(0.9, 0.5, 2.9) == other.move(seen(0.5, r=0.9, u=2.9)).u[0] != alone.step(0.9, 0.5)


@pytest.mark.parametrize("b", [0.0, 0.3, 1.0])
def test_a_reference_step_kicks_by_its_weight(b):
    assert PID(3.0, 4.0, 1.0, T_s=0.1, b=b).move(seen(0.0, r=2.0)).u == pytest.approx(6.0 * b)


@pytest.mark.parametrize("T_d", [0.01, 1.0, 100.0])
def test_noise_is_amplified_by_no_more_than_the_filter_allows(T_d):
    pid = PID(1.0, T_d=T_d, T_s=0.1, N=10.0)
    pid.move(seen(0.0))
    assert abs(pid.move(seen(1.0)).u[0]) <= 1.0 + 10.0


def test_gains_and_times_are_the_same_controller():
    a = PID.of_gains(2.0, 0.5, 1.0, T_s=0.1).parameters
    assert (a["T_i"], a["T_d"]) == (4.0, 0.5)


def test_each_pid_moves_its_own_input():
    both = Decentralized([PID(1.0, T_s=0.1), PID(2.0, T_s=0.1, output=1, input=2)])
    u = both.move(seen([0.0, 0.0], r=[1.0, 1.0], u=[5.0, 6.0, 7.0])).u
    assert u == pytest.approx([6.0, 6.0, 9.0])


def test_a_controller_survives_as_data():
    pids = [PID(1.0, T_s=0.1, high=4.0), PID(-2.0, 3.0, 1.0, T_s=0.1, output=1, input=1)]
    data = as_data(Decentralized(pids))
    assert as_data(from_data(data)) == data
    assert from_data(as_data(pids[0])).parameters == pids[0].parameters


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"T_i": 0.0}, "T_i must be above 0"),
        ({"T_d": -1.0}, "T_d must be 0 or more"),
        ({"K_p": np.inf}, "K_p must be finite"),
        ({"T_s": 0.0}, "T_s must be above 0"),
        ({"low": 2.0, "high": 1.0}, "low must be below high"),
        ({"b": "much"}, "b must be a number"),
        ({"output": -1}, "output must be a name or a number"),
        ({"input": "valve"}, "a name needs the plant"),
    ],
)
def test_impossible_parameters_are_refused(wrong, said):
    with pytest.raises(SettingsError, match=said):
        PID(**({"K_p": 1.0, "T_s": 0.1} | wrong))


@pytest.mark.parametrize("data", [{}, {"controller": "MPC"}, {"controller": "PID", "K": 1}])
def test_data_of_no_controller_are_refused(data):
    with pytest.raises(SettingsError):
        from_data(data)


LAG = Plant.of(([2.0], [5, 6, 1]), delay=0.7, inputs=[Channel("u")], outputs=[Channel("y")])
TUNING = Tuning(1.2, 4.0, 0.6)


def lag_sampled():
    return sampled(LAG.system, 0.25, np.array([[0.7]]))


@pytest.mark.parametrize("b", [1.0, 0.3])
def test_a_step_of_the_reference_is_answered_as_by_the_running_pid(b):
    pid = PID(TUNING.K_p, TUNING.T_i, TUNING.T_d, T_s=0.25, N=8.0, b=b)
    task = Task(x0=np.zeros(2), u0=np.zeros(1), y_ref=np.ones(1), horizon=20.0, dense_step=0.25)
    e = rollout(PlantEnv(LAG, task), pid, np.zeros(1))
    plant, law = lag_sampled(), LinearPIDs.of([TUNING], 8.0)
    M, drive = law.loops(plant)[0], law.drive(plant, b)[:, 0]
    x, step = np.zeros(len(M)), []
    for _ in e.t:
        step.append(plant.C[0] @ x[: len(plant.A)])
        x = M @ x + drive
    assert np.abs(e.output(0) - step).max() < 1e-9


def test_the_response_is_that_of_a_pid_at_low_frequencies():
    law = PIDLaw.of(2.0, 5.0, 1.5, N=10.0, T_s=0.001)
    s = 0.3j
    assert law.at(np.exp(s * 0.001)) == pytest.approx(
        2 * (1 + 1 / (5 * s) + 1.5 * s / (1 + 0.15 * s)), rel=1e-3
    )


def test_one_pid_of_a_pair_is_as_sensitive_as_alone_if_nothing_couples_them():
    two = system_of((-np.diag([1.0, 2.0]), np.eye(2), np.eye(2), np.zeros((2, 2))))
    omega = np.geomspace(1e-3, 30, 200)
    slow, fast = Tuning(1.0, 2.0), Tuning(3.0, 1.0, 0.1)
    both = LinearPIDs.of([slow, fast], 10.0).sensitivities(sampled(two, 0.1), omega).max()
    alone = [
        LinearPIDs.of([t], 10.0).sensitivities(sampled(two.part([i], [i]), 0.1), omega).max()
        for i, t in enumerate((slow, fast))
    ]
    assert both == pytest.approx(max(alone))


def test_sets_are_checked_together_as_each_alone():
    omega = np.geomspace(1e-3, 12, 100)
    gains = np.array([[0.5], [1.5], [400.0]])
    together = LinearPIDs(gains, np.full((3, 1), 4.0), np.zeros((3, 1)), 10.0)
    peaks = together.peak(lag_sampled(), omega)
    for gain, peak in zip(gains[:, 0], peaks, strict=True):
        alone = LinearPIDs.of([Tuning(gain, 4.0)], 10.0).peak(lag_sampled(), omega)
        assert peak == pytest.approx(alone[0])
    assert np.isinf(peaks[2])
    assert together.stable(lag_sampled()).tolist() == [True, True, False]


OMEGA = np.geomspace(1e-3, 30, 400)


def tuned(den, num=(1.0,), T_s=0.1):
    plant = sampled(Plant.of((list(num), list(den))).system, T_s)
    found = migo(plant, OMEGA[np.pi / T_s > OMEGA], np.geomspace(0.05, 8, 26))
    assert found is not None
    return plant, found


@pytest.mark.parametrize("den", [[1, 4, 6, 4, 1], [1, 2, 1], [1, 1, 0], [1, 0.8, 1]])
def test_the_derivative_time_stays_a_quarter_of_the_integral_time(den):
    # Of (s + 1)^-4 the largest integral gain alone has T_d = 2.8 T_i, and a step rings for 25 s.
    plant, tuning = tuned(den)
    assert tuning.T_i >= 3.5 * tuning.T_d > 0
    assert LinearPIDs.of([tuning], 10.0).peak(plant, OMEGA)[0] <= 1.6


def overshoot(plant, tuning):
    law, x = LinearPIDs.of([tuning], 10.0), np.zeros(len(plant.A) + 2)
    M, drive, y = law.loops(plant)[0], law.drive(plant, tuning.b)[:, 0], []
    for _ in range(1000):
        y.append(plant.C[0] @ x[: len(plant.A)])
        x = M @ x + drive
    assert y[-1] == pytest.approx(1.0, abs=0.01)
    return max(y) - 1


@pytest.mark.parametrize("den", [[1, 2, 1], [1, 1, 0], [1, 0.8, 1]])
def test_the_set_point_weight_takes_off_what_a_step_overshoots(den):
    plant, tuning = tuned(den)
    assert 0 <= tuning.b < 1
    assert overshoot(plant, tuning) < 0.1
    assert overshoot(plant, replace(tuning, b=1.0)) > 2 * overshoot(plant, tuning)


def test_a_plant_of_dead_time_needs_no_set_point_weight():
    plant = sampled(Plant.of(([1.0], [0.05, 1.0])).system, 0.2, np.array([[1.0]]))
    found = migo(plant, np.geomspace(1e-3, 15, 400), np.geomspace(0.03, 4, 26))
    assert found is not None
    assert found.b == 1.0


@pytest.mark.parametrize("den", [[1, 0], [1, 1], [1, -1]])
def test_the_complementary_sensitivity_is_limited_too(den):
    # A PI of an integrator or a lag is robust by M_s however short T_i is, and rings: K_p T_i is its damping.
    plant, tuning = tuned(den)
    z = np.exp(1j * OMEGA * plant.dt)
    law = PIDLaw.of(tuning.K_p, tuning.T_i, tuning.T_d, N=10.0, T_s=plant.dt)
    L = plant.at(1j * OMEGA)[:, 0, 0] * law.at(z)
    assert np.abs(L / (1 + L)).max() <= 1.6
