import json

import numpy as np
import pytest

from prefcal_env import LQG, LQR, Channel, FunctionPlant, Measurement, PlantEnv, Task, rollout
from prefcal_env.controllers import as_data, from_data
from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import held

A = np.array([[0.0, 1.0], [0.5, -0.4]])  # unstable
B, C = np.array([[0.0], [2.0]]), np.array([[1.0, 0.0]])
T_S = 0.1


def made(**limits):
    return Plant.of((A, B, C, [[0.0]]), inputs=[Channel("force", "N", **limits)])


def feedback(plant=None, **others):
    return LQR(plant or made(), [10.0, 1.0], [0.5], T_s=T_S, **others)


def run(controller, *, plant=None, x0=(0.0, 0.0), y_ref=1.0, d=None, horizon=20.0):
    reference = y_ref if callable(y_ref) else np.array([y_ref])
    task = Task(np.array(x0), np.zeros(1), reference, horizon, dense_step=T_S)
    return rollout(PlantEnv(plant or made(), task), controller, np.ones(1))


def test_the_gain_is_that_of_python_control():
    control = pytest.importorskip("control")
    A_d, B_d = held(A, B, T_S)
    K, _, _ = control.dlqr(A_d, B_d, np.diag([10.0, 1.0]), np.array([[0.5]]))
    assert pytest.approx(np.asarray(K), rel=1e-8) == feedback().K


def test_the_gain_with_integral_action_is_that_of_python_control():
    control = pytest.importorskip("control")
    A_d, B_d = held(A, B, T_S)
    A_q = np.block([[A_d, np.zeros((2, 1))], [T_S * C, np.eye(1)]])
    B_q = np.vstack([B_d, [[0.0]]])
    K, _, _ = control.dlqr(A_q, B_q, np.diag([10.0, 1.0, 3.0]), np.array([[0.5]]))
    lqr = feedback(integral=["y"], Q_i=[3.0])
    assert np.hstack([lqr.K, lqr.K_i]) == pytest.approx(np.asarray(K), rel=1e-8)


def test_the_first_correction_of_the_filter_is_that_of_python_control():
    control = pytest.importorskip("control")
    A_d, _ = held(A, B, T_S)
    Q, R = np.diag([0.01, 0.04]) * T_S, np.array([[0.09]])
    # dlqe's gain is that of the predictor, A M.
    L, _, _ = control.dlqe(A_d, np.eye(2), C, Q, R)
    lqg = LQG(feedback(), [0.3], [0.1, 0.2])
    y = np.array([1.0])
    lqg.move(Measurement(0.0, np.zeros(2), np.zeros(1), np.zeros(0), np.zeros(1), y))
    assert A_d @ lqg.estimate == pytest.approx(np.asarray(L)[:, 0], rel=1e-6)


def test_an_unstable_plant_comes_to_its_reference():
    e = run(feedback())
    assert e.output(0)[-1] == pytest.approx(1.0, abs=1e-6)


def test_only_integral_action_removes_the_offset_of_a_wrong_model():
    real = Plant.of((A, 0.7 * B, C, [[0.0]]))
    assert abs(run(feedback(), plant=real).output(0)[-1] - 1) > 0.01
    lqr = feedback(integral=["y"], Q_i=[10.0])
    assert run(lqr, plant=real).output(0)[-1] == pytest.approx(1.0, abs=1e-4)


def test_the_integral_does_not_wind_up_while_the_input_is_limited():
    plant = Plant.of(([1.0], [5.0, 1.0]), inputs=[Channel("u", "", -2, 2)])

    def reference(t):
        return np.array([10.0 if t < 30 else 1.0])  # 10 is beyond reach

    lqr = LQR(plant, [1.0], [1.0], T_s=T_S, integral=[0], Q_i=[1.0])
    e = run(lqr, plant=plant, x0=(0.0,), y_ref=reference, horizon=60.0)
    y = e.output(0)
    assert y[e.t < 30].max() == pytest.approx(2.0, abs=0.01)
    # It leaves the limit within a few samples, and comes to its reference.
    assert e.u[e.t[: len(e.u)] > 33][0, 0] < 1.9
    assert y[-1] == pytest.approx(1.0, abs=0.01)


def test_lqg_needs_the_measured_outputs_alone():
    one, other = (LQG(feedback(), [0.1], [0.1, 0.1]) for _ in range(2))
    y = np.array([0.4])
    seen = [
        Measurement(0.0, x, np.zeros(1), np.zeros(0), np.ones(1), y)
        for x in (np.zeros(2), np.array([5.0, -3.0]))
    ]
    assert one.move(seen[0]).u == other.move(seen[1]).u


def test_lqg_finds_the_state_and_controls_it():
    lqg = LQG(feedback(), [0.01], [0.1, 0.1])
    e = run(lqg, x0=(0.5, -0.5), y_ref=0.0)
    assert e.output(0)[-1] == pytest.approx(0.0, abs=1e-4)
    assert lqg.estimate == pytest.approx(e.x[-1], abs=1e-3)


def test_a_nonlinear_plant_is_linearized_where_it_rests():
    tank = FunctionPlant(
        lambda x, u, d: [0.2 * u[0] - 0.1 * np.sqrt(np.maximum(x[0], 0))],
        states=[Channel("level", "m")],
        inputs=[Channel("valve", "", 0, 5)],
    )
    lqr = LQR(tank, [1.0], [1.0], T_s=1.0, x0=[4.0], u0=[1.0], integral=["level"], Q_i=[0.01])
    assert lqr.model.A[0, 0] == pytest.approx(-0.025, rel=1e-5)
    with pytest.raises(SettingsError, match="does not rest"):
        LQR(tank, [1.0], [1.0], T_s=1.0, x0=[4.0], u0=[2.0])
    task = Task(np.array([4.0]), np.ones(1), np.array([5.0]), 200.0)
    e = rollout(PlantEnv(tank, task), lqr, np.ones(1))
    assert e.output(0)[-1] == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("estimates", [False, True])
def test_a_file_holds_the_whole_controller(estimates):
    def controller():
        lqr = feedback(made(low=-3.0), integral=[0], Q_i=[2.0])
        return LQG(lqr, [0.1], [0.1, 0.2]) if estimates else lqr

    data = json.loads(json.dumps(as_data(controller()), allow_nan=False))
    assert as_data(from_data(data)) == data
    first, second = run(controller()), run(from_data(data))
    assert np.array_equal(first.u, second.u)


def test_without_a_reference_it_stays_at_rest():
    e = run(feedback(), y_ref=np.nan)
    assert np.array_equal(e.u, np.zeros_like(e.u))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"Q": [1.0]}, "Q must be a finite square matrix, shape .2, 2."),
        ({"Q": [-1.0, 1.0]}, "Q must be positive semidefinite"),
        ({"R": [0.0]}, "R must be positive definite"),
        ({"T_s": 0.0}, "T_s must be above 0"),
        ({"integral": ["z"], "Q_i": [1.0]}, "output must be one of"),
        ({"integral": ["y"]}, "Q_i must be a finite square matrix, shape .1, 1."),
        ({"x0": [1.0]}, "x0 must hold 2 numbers"),
    ],
)
def test_what_does_not_fit_is_refused(wrong, said):
    given = {"Q": [1.0, 1.0], "R": [1.0], "T_s": T_S, **wrong}
    with pytest.raises(SettingsError, match=said):
        LQR(made(), given.pop("Q"), given.pop("R"), **given)


def test_a_plant_that_cannot_be_stabilized_or_observed_is_refused():
    stuck = Plant.of((np.diag([1.0, -1.0]), [[0.0], [1.0]], [[0.0, 1.0]], [[0.0]]))
    with pytest.raises(SettingsError, match="no state feedback"):
        LQR(stuck, [1.0, 1.0], [1.0], T_s=T_S)
    hidden = Plant.of((np.diag([1.0, -1.0]), [[1.0], [1.0]], [[0.0, 1.0]], [[0.0]]))
    lqr = LQR(hidden, [1.0, 1.0], [1.0], T_s=T_S)
    with pytest.raises(SettingsError, match="do not tell the plant's state"):
        LQG(lqr, [0.1], [0.1, 0.1])
    with pytest.raises(SettingsError, match="noise must be finite and above 0"):
        LQG(feedback(), [0.0], [0.1, 0.1])


@pytest.mark.parametrize("data", [{"controller": "LQR"}, {"controller": "LQG", "lqr": {}}])
def test_data_that_lack_something_are_refused(data):
    with pytest.raises(SettingsError, match="do not fit"):
        from_data(data)
