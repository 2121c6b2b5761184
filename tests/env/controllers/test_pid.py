import numpy as np
import pytest

from prefcal_env import PID, Channel, Measurement, PlantEnv, Task, rollout
from prefcal_env.controllers import as_data, from_data
from prefcal_env.controllers.pid import Decentralized
from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant


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
