"""LQR and margins, against python-control, systems whose margins are known, and laws as they run."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq

from prefcal_env import LQG, LQR, Channel, FunctionPlant, Measurement, Move, PlantEnv, Task, rollout
from prefcal_env.controllers import as_data, from_data
from prefcal_env.controllers.lqr import linearized
from prefcal_env.controllers.margins import UNSTABLE, MarginKPIs, margin_kpis, margins, margins_of, sampled
from prefcal_env.controllers.pid import PID, PIDLaw
from prefcal_env.envs.closed_loop import ClosedLoop
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


@pytest.mark.parametrize("name", ["A", "B", "C", "Q_i"])
def test_a_number_in_the_data_is_no_matrix(name):
    data = as_data(LQR(Plant.of(([1.0], [2.0, 1.0])), [1.0], [1.0], T_s=T_S, integral=[0], Q_i=[2.0]))
    (data if name == "Q_i" else data["model"])[name] = 3
    with pytest.raises(SettingsError, match=rf"{name} must have shape \(1, 1\), got \(\)"):
        from_data(data)


def at_rest(plant, x0=None, u0=None):
    """A task that starts at rest, at 0 unless it is given."""
    x0, u0 = (np.zeros(len(c)) if v is None else v for c, v in ((plant.states, x0), (plant.inputs, u0)))
    return Task(x0, u0, plant.g(x0, u0, np.zeros(0)), horizon=1.0)


GRID = np.geomspace(1e-4, 1e4, 4000)
LAGS = ([1.0], [1.0, 3.0, 3.0, 1.0])


def sensitivity(system):
    """The sensitivity of a continuous loop, as a function of frequency."""

    def at(omega):
        L = np.moveaxis(np.atleast_3d(system(1j * omega, squeeze=False)), -1, 0)
        return np.linalg.inv(np.eye(L.shape[-1]) + L)

    return at


def loop_of(control, plant, delay, T_s, K_p, T_i, T_d, N):
    """The open loop of a sampled plant and PID, by python-control."""
    G, law = sampled(plant.system, T_s, np.array([[delay]])), PIDLaw.of(K_p, T_i, T_d, N=N, T_s=T_s)
    direct, slope = law.of_output
    C = control.tf([-direct], [1], T_s) + control.tf([law.integral], [1, -1], T_s)
    if T_d:  # a part that is 0 would cost python-control its digits
        C -= control.tf([slope], [1, -law.pole], T_s)
    return control.ss(G.A, G.B, G.C, G.D, T_s) * control.ss(C)


@pytest.mark.filterwarnings("ignore")  # python-control warns of its own polynomials
@pytest.mark.parametrize(
    ("system", "delay", "T_s", "pid"),
    [
        (LAGS, 0.25, 0.1, (2.0, 3.0, 0.7, 8.0)),
        (LAGS, 0.0, 0.2, (4.0, 2.5, 1.0, 10.0)),
        (([2.0], [5.0, 1.0]), 1.0, 0.5, (1.2, 3.0, 0.0, 10.0)),
        (([0.05], [2.0, 1.0, 0.0]), 1.3, 0.5, (1.5, 60.0, 2.0, 5.0)),
        (([1.0], [1.0, 0.1, 1.0]), 0.0, 0.05, (0.2, 0.6, 3.0, 10.0)),
    ],
)
def test_the_margins_of_a_pid_are_those_of_python_control(system, delay, T_s, pid):
    control = pytest.importorskip("control")
    plant = Plant.of(system, delay=delay)
    K_p, T_i, T_d, N = pid
    make = partial(PID, K_p, T_i, T_d, T_s=T_s, N=N)
    found = margins(plant, at_rest(plant), make)
    L = loop_of(control, plant, delay, T_s, K_p, T_i, T_d, N)
    GM, _, SM, _, at, _ = control.stability_margins(L, returnall=True)
    assert found != UNSTABLE
    assert found.gain == pytest.approx(min(g for g in GM if g > 1), rel=1e-6)
    # On some processors its polynomials give five digits of a crossing: from there, the root of |L| = 1.
    at = np.array([brentq(lambda w: abs(L(np.exp(1j * w * T_s))) - 1, 0.99 * w, 1.01 * w) for w in at])
    PM = np.rad2deg(np.angle(-L(np.exp(1j * at * T_s))))
    assert found.phase == pytest.approx(min(abs(PM)), rel=1e-6)
    assert found.M_s == pytest.approx(1 / min(SM), rel=1e-6)
    assert found.delay == pytest.approx(min(np.deg2rad(PM % 360) / at), rel=1e-6)
    omega = np.geomspace(1e-2, np.pi / T_s, 30_000)
    assert found.disk == pytest.approx(control.disk_margins(L, omega)[0], rel=1e-6)


def test_the_disk_margin_of_the_article_by_seiler_and_others():
    control = pytest.importorskip("control")
    L = control.tf([25], [1, 10, 10, 10])  # its section "SISO", α = 0.46, gains 0.63 to 1.59, 26°
    found = margins_of(sensitivity(L), GRID)
    assert found.disk == pytest.approx(0.46, abs=0.005)
    gain = (2 + found.disk) / (2 - found.disk)
    assert (1 / gain, gain) == pytest.approx((0.63, 1.59), abs=0.005)
    assert np.rad2deg(2 * np.arctan(found.disk / 2)) == pytest.approx(26, abs=0.5)
    assert found.gain == pytest.approx(control.margin(L)[0], rel=1e-6)


def test_the_open_loop_has_the_points_where_margins_are_read():
    control = pytest.importorskip("control")
    L = control.tf([25], [1, 10, 10, 10])
    found = margins_of(sensitivity(L), GRID)
    assert found.loop.L[:, 0] == pytest.approx(L(1j * found.loop.omega), rel=1e-6)
    gain, phase, at_gain, at_phase = control.margin(L)
    assert set(found.loop.points) == {"gain", "phase"}, "no smaller gain makes it unstable"
    for name, omega, value in (
        ("gain", at_gain, -1 / gain),
        ("phase", at_phase, -np.exp(1j * np.deg2rad(phase))),
    ):
        assert found.loop.points[name] == (pytest.approx(omega), pytest.approx(value))
    assert UNSTABLE.loop is None


@pytest.mark.parametrize("a", [0.5, 2.0, 10.0])
def test_a_spinning_body_has_perfect_loops_one_at_a_time_and_a_small_disk_margin(a):
    def spinning(omega):  # S = [[s, -a], [a, s]] / (s + 1)
        s = 1j * omega
        S = np.array([[s, -a + 0 * s], [a + 0 * s, s]]) / (s + 1)
        return np.moveaxis(S, -1, 0)

    found = margins_of(spinning, GRID)
    assert (found.gain, found.gain_reduction, found.phase) == (np.inf, 0.0, pytest.approx(90, abs=0.1))
    # S - T = [[s - 1, -2a], [2a, s - 1]] / (s + 1): its singular values are |jω - 1 ± 2ja| / |jω + 1|
    assert found.disk == pytest.approx(2 / (a + np.sqrt(a**2 + 1)), rel=1e-6)


def test_scaling_an_input_changes_m_s_but_no_disk_margin():
    def coupled(omega, k):
        s = 1j * omega
        L = np.array([[2 / (s + 1) ** 2, 0.7 * k / (s + 1)], [0.2 / k / (s + 1), 1 / (s + 0.5)]])
        return np.linalg.inv(np.eye(2) + np.moveaxis(L, -1, 0))

    one, other = (margins_of(partial(coupled, k=k), GRID) for k in (1.0, 30.0))
    assert other.disk == pytest.approx(one.disk, rel=1e-6)
    assert other.M_s > 1.5 * one.M_s


def test_state_feedback_without_sampling_would_have_60_degrees_and_half_the_gain():
    plant = Plant.of(([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), np.zeros((2, 1))))
    model = linearized(plant, None, None, None, 1.0)
    made = partial(LQR, model, np.diag([1.0, 0.0]), [[1.0]], T_s=0.002)
    found = margins(plant, at_rest(plant), made)
    assert found.phase > 59
    assert found.M_s == pytest.approx(1.0, abs=0.01)
    assert found.gain_reduction < 0.5


def test_steady_feedback_of_an_unstable_plant_has_a_lower_gain_margin():
    plant = Plant.of(([1.0], [1.0, -0.5]), inputs=[Channel("u", "", -10, 10)])
    K = float(LQR(plant, [1.0], [0.5], T_s=T_S).K[0, 0])
    a = np.exp(0.5 * T_S)
    least = (a - 1) / (K * (a - 1) / 0.5)  # a - K g b = 1, where the pole leaves the unit circle at 1
    found = margins(plant, at_rest(plant), partial(LQR, plant, [1.0], [0.5], T_s=T_S))
    assert found.gain_reduction == pytest.approx(least, rel=1e-6)
    for share, stable in ((0.99, False), (1.01, True)):

        class Weaker:
            T_s = T_S

            def __init__(self, share=share):
                self.law, self.share = LQR(plant, [1.0], [0.5], T_s=T_S), share * least

            def move(self, m):
                return Move(self.share * self.law.move(m).u)

        assert (margins(plant, at_rest(plant), Weaker) != UNSTABLE) is stable


@pytest.mark.parametrize(("K_p", "T_i"), [(1.1, 2e3), (1.1, 1e4), (1.108, 500.0), (0.5, 1e4), (0.5, 2e4)])
def test_a_slow_integral_counts_to_its_end(K_p, T_i):
    plant = Plant.of(([0.9], [1.0, 1.0]), inputs=[Channel("u", "", -10, 10)])
    found = margins(plant, at_rest(plant), partial(PID, K_p, T_i, T_s=T_S))
    law, pole = PIDLaw.of(K_p, T_i, 0.0, N=10.0, T_s=T_S), np.exp(-T_S)

    def L(omega):
        z = np.exp(1j * omega * T_S)
        return (-law.of_output[0] + law.integral / (z - 1)) * 0.9 * (1 - pole) / (z - pole)

    at = brentq(lambda w: abs(L(w)) - 1, 1e-8, 0.5)
    assert found.phase == pytest.approx(abs(np.rad2deg(np.angle(-L(at)))), abs=0.01)
    assert found.gain_reduction == 0


class DeadBand:
    """A law that does not see what is within a band around 0."""

    T_s = T_S

    def __init__(self, law, band):
        self.law, self.band = law, band

    def move(self, m):
        seen = np.sign(m.y) * np.maximum(np.abs(m.y) - self.band, 0.0)
        return self.law.move(Measurement(m.t, m.x, m.u, m.d, m.y_ref, seen))


def test_a_dead_band_has_no_margins_and_a_gain_of_0_has_all():
    plant = Plant.of(LAGS, inputs=[Channel("valve", "%", -100, 100)])

    def law(K):
        return DeadBand(PID(K, 3.0, T_s=T_S), 0.5)

    with pytest.raises(
        SettingsError, match="answers no small deviations, but large ones, as with a dead band"
    ):
        margins(plant, at_rest(plant), partial(law, 60.0))  # unstable outside of it
    found = margins(plant, at_rest(plant), partial(law, 0.0))
    assert (found.gain, found.gain_reduction, found.phase, found.M_s) == (np.inf, 0.0, 180.0, 1.0)


def test_an_unstable_loop_has_no_margins():
    made, plant = partial(PID, 60.0, 3.0, T_s=0.1), Plant.of(LAGS)
    assert margins(plant, at_rest(plant), made) is UNSTABLE


UNLUCKY = (13.334517819826125, 1.9012559111597516, 8.675713287676295, 0.5604964436423991)


def test_a_loop_that_rests_at_the_limits_of_its_input_before_the_impulse_is_not_stable():
    """It grows from rounding alone, and ends in the same cycle whatever the impulse: that is no dead band."""
    valve = Channel("valve", "%", low=0, high=100)
    plant = Plant.of(([1.6], [320, 48, 1]), delay=7.0, inputs=[valve])
    middle = Task(np.zeros(2), np.array([50.0]), np.zeros(1), horizon=100.0)
    task = replace(middle, x0=np.linalg.solve(plant.system.A, -plant.system.B @ middle.u0))
    K_p, T_i, T_d, b = UNLUCKY
    for factor, stable in ((0.05, True), (1.0, False), (1.1, False), (5.0, False), (20.0, False)):
        made = partial(PID, factor * K_p, 20 * T_i, T_d, b=b, T_s=1.0, low=0.0, high=100.0)
        assert (margins(plant, task, made) != UNSTABLE) == stable, factor
    assert margins(plant, task, partial(PID, K_p, T_i, T_d, b=b, T_s=1.0, low=0.0, high=100.0)) == UNSTABLE


def test_an_input_at_its_limit_has_no_linear_law():
    plant = Plant.of(LAGS, inputs=[Channel("valve", "%", 0, 100)])
    with pytest.raises(SettingsError, match="input 'valve' rests at 0 %, a limit"):
        margins(plant, at_rest(plant), partial(PID, 1.0, T_s=0.1))


def test_the_law_of_an_mpc_is_that_of_a_simulation():
    """A sine at the plant's input, through the nonlinear plant, estimator and MPC."""
    from prefcal_scenarios.cases.loops.family import LOOPS

    loop = LOOPS["mpc-quadruple-tank"]()
    plant, task, T_s = loop.plant, loop.task, 12.0
    values = {"N_p": 20, "N_u": 4, "Q_du": 0.1, "Q_2": 1.0, "drift": 0.01}
    make = partial(loop.controller.make, values, plant, task, T_s)
    x0, u0, d0 = task.x0, task.u0, task.disturbance(0.0)
    found = margins(plant, task, make, settle=600)
    assert found != UNSTABLE
    assert found.M_s > 1.05
    periods, samples, size = 12, 24, 0.01
    omega = 2 * np.pi / (samples * T_s)
    S = np.zeros((2, 2), dtype=complex)
    for j in range(2):
        controller, x, u, seen = make(), x0, u0, []
        for k in range(600 + periods * samples):
            load = size * np.sin(2 * np.pi * k / samples) * np.eye(2)[j]
            u = controller.move(Measurement(k * T_s, x, u, d0, plant.g(x0, u0, d0))).u
            seen.append(u + load - u0)
            x = plant.hold(x, u + load, d0, np.array([T_s]))[-1]
        last = np.array(seen[-4 * samples :])
        wave = np.exp(-2j * np.pi * np.arange(len(last)) / samples)
        S[:, j] = 2j * (wave @ last) / len(last) / size
    expected = np.linalg.svd(S, compute_uv=False)
    response = found_response(plant, task, make)(np.array([omega]))[0]
    assert np.linalg.svd(response, compute_uv=False) == pytest.approx(expected, rel=0.02)
    assert response == pytest.approx(S, abs=0.02 * expected[0])


def found_response(plant, task, make):
    """The sensitivity that `margins` uses, caught on its way."""
    from prefcal_env.controllers import margins as module

    caught = []
    patch = pytest.MonkeyPatch()
    with patch.context() as context:
        context.setattr(module, "margins_of", lambda response, omega: caught.append(response))
        margins(plant, task, make, settle=600)
    return caught[0]


@pytest.mark.parametrize("make", [lambda: PID(2.0, 3.0, 0.7, T_s=0.1), lambda: feedback()])
def test_margins_behind_a_lag_are_those_of_a_plant_that_has_it_as_a_state(make):
    plant = made() if isinstance(make(), LQR) else Plant.of(LAGS)
    J, n, lag = plant.system, len(plant.x0), 0.03
    A_2 = np.block([[J.A, J.B], [np.zeros((1, n)), np.full((1, 1), -1 / lag)]])
    C_2 = np.hstack([J.C, J.D])
    slow = Plant.of((A_2, np.vstack([np.zeros((n, 1)), [[1 / lag]]]), C_2, [[0.0]]))
    task = Task(np.zeros(n), np.zeros(1), np.zeros(1), horizon=20.0, T_s=0.1)

    class Blind:
        """The same controller, which does not see the state of the lag."""

        T_s = 0.1

        def __init__(self):
            self.own = make()

        def move(self, m):
            return self.own.move(replace(m, x=m.x[:n]))

    behind = margins(plant, replace(task, lag=lag), make)
    same = margins(slow, replace(task, x0=np.zeros(n + 1)), Blind)
    without = margins(plant, task, make)
    for name in ("M_s", "gain", "gain_reduction", "phase", "delay", "disk"):
        assert getattr(behind, name) == pytest.approx(getattr(same, name), rel=1e-6)
    assert behind.phase < without.phase - 1
    assert behind.delay < without.delay


def test_margins_are_kpis_that_can_be_limits():
    plant = Plant.of(LAGS, inputs=[Channel("valve", "%", -100, 100)])
    task = Task(np.zeros(3), np.zeros(1), np.ones(1), horizon=20.0, T_s=0.1)
    loop = ClosedLoop(PlantEnv(plant, task), lambda theta: PID(theta[0], 3.0, 0.7, T_s=0.1))
    kpis = {kpi.name: kpi for kpi in margin_kpis("s")}
    calm, fast, wild = (MarginKPIs(loop)(loop(np.array([K]))) for K in (0.01, 2.0, 60.0))
    assert set(kpis) == set(fast)
    assert wild == dict.fromkeys(kpis, 0.0) | {"M_s": np.inf}
    assert 1 < calm["M_s"] < fast["M_s"] < np.inf
    assert fast["M_s"] == margins(plant, task, partial(loop.controller, np.array([2.0]))).M_s
    own = replace(loop(np.array([2.0])), kpis={"M_s": 1.5})
    assert MarginKPIs(loop)(own)["M_s"] == 1.5
    assert fast["gain_margin"] < calm["gain_margin"] <= 60
    assert all(np.isfinite(list(calm.values())))
