"""Margins: those of python-control, of systems whose margins are known, and of laws as they run."""

from functools import partial

import numpy as np
import pytest

from prefcal_env.controllers.lqr import LQR, linearized
from prefcal_env.controllers.margins import UNSTABLE, MarginKPIs, margin_kpis, margins, margins_of, sampled
from prefcal_env.controllers.pid import PID, PIDLaw
from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.task import Task
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel, Measurement
from prefcal_env.plants.plant import Plant


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
    GM, PM, SM, _, at, _ = control.stability_margins(L, returnall=True)
    assert found != UNSTABLE
    assert found.gain == pytest.approx(min(g for g in GM if g > 1), rel=1e-6)
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


def test_an_unstable_loop_has_no_margins():
    made, plant = partial(PID, 60.0, 3.0, T_s=0.1), Plant.of(LAGS)
    assert margins(plant, at_rest(plant), made) is UNSTABLE


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


def test_margins_are_kpis_that_can_be_limits():
    plant = Plant.of(LAGS, inputs=[Channel("valve", "%", -100, 100)])
    task = Task(np.zeros(3), np.zeros(1), np.ones(1), horizon=20.0, T_s=0.1)
    loop = ClosedLoop(PlantEnv(plant, task), lambda theta: PID(theta[0], 3.0, 0.7, T_s=0.1))
    kpis = {kpi.name: kpi for kpi in margin_kpis("s")}
    calm, fast, wild = (MarginKPIs(loop)(loop(np.array([K]))) for K in (0.01, 2.0, 60.0))
    assert set(kpis) == set(fast)
    assert wild == dict.fromkeys(kpis, 0.0)
    assert fast["gain_margin"] < calm["gain_margin"] <= 60
    assert all(np.isfinite(list(calm.values())))
