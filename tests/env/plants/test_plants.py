"""The paper's plants, plants with disturbances, and what kernels and derivatives make of their equations."""

import math
import pickle
import threading
from dataclasses import fields
from math import pi

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import event
from scipy.integrate import solve_ivp

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channel, Measurement
from prefcal_env.mpc import LinearMPC, MPCSettings
from prefcal_env.plants import FunctionPlant
from prefcal_env.plants._dop853 import call
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cstr import CSTR, FEED, CSTRParams
from prefcal_env.plants.jacobians import derivative
from prefcal_env.plants.plant import Callbacks, Disturbed

BICYCLE, NONE = Bicycle(), np.zeros(0)
poses = st.tuples(st.floats(-50, 50), st.floats(-5, 5), st.floats(-1, 1)).map(np.array)
steering = st.tuples(st.floats(0, 20), st.floats(-pi / 4, pi / 4)).map(np.array)


@given(x=poses, u=steering, T=st.floats(0.01, 2))
def test_the_hold_is_exact(x, u, T):
    precise = solve_ivp(
        lambda t, y: BICYCLE.f(y, u, NONE), (0, T), x, method="DOP853", rtol=1e-13, atol=1e-13
    ).y[:, -1]
    np.testing.assert_allclose(BICYCLE.hold(x, u, NONE, np.array([T]))[0], precise, atol=1e-9)


def test_left_is_positive():
    x = BICYCLE.hold(np.zeros(3), np.array([10.0, 0.1]), NONE, np.array([1.0]))[0]
    assert x[1] > 0
    assert x[2] > 0


@given(x=poses, u=steering)
def test_jacobians_of_the_bicycle_agree_with_differences(x, u):
    J, h = BICYCLE.jacobians(x, u, NONE), 1e-6
    for i in range(3):
        e = h * np.eye(3)[i]
        slope = (BICYCLE.f(x + e, u, NONE) - BICYCLE.f(x - e, u, NONE)) / (2 * h)
        np.testing.assert_allclose(J.A[:, i], slope, atol=1e-6)
    for i in range(2):
        e = h * np.eye(2)[i]
        slope = (BICYCLE.f(x, u + e, NONE) - BICYCLE.f(x, u - e, NONE)) / (2 * h)
        np.testing.assert_allclose(J.B[:, i], slope, atol=1e-6)


@pytest.mark.parametrize("length", [0.0, -4.5, np.inf, np.nan])
def test_an_impossible_length_is_refused(length):
    with pytest.raises(PlantError, match="length L"):
        Bicycle(length)


REACTOR = CSTR()
states = st.tuples(st.floats(290, 400), st.floats(0.05, 9.95)).map(np.array)
inputs = st.floats(284, 310).map(lambda v: np.array([v]))


def test_three_steady_states_at_298_kelvin_the_papers_start_among_them():
    found = REACTOR.steady_states_at_input(298.0)
    assert len(found) == 3
    assert found[0] == pytest.approx([311.5, 8.54], rel=1e-3)  # design, section 4
    assert found[0, 1] == pytest.approx(8.56, rel=0.005)  # paper, section IV-A
    assert np.all(np.diff(found[:, 0]) > 0)


def test_paper_start_and_target_by_concentration():
    x, u = REACTOR.steady_state_at_concentration(8.56)
    assert (x[0], u[0]) == pytest.approx((311.23, 297.62), abs=0.01)
    _, u = REACTOR.steady_state_at_concentration(2.0)
    assert u[0] == pytest.approx(304.4, abs=0.05)


@given(C_A=st.floats(0.2, 9.8))
def test_a_steady_state_stands_still(C_A):
    x, u = REACTOR.steady_state_at_concentration(C_A)
    np.testing.assert_allclose(REACTOR.f(x, u, FEED), 0, atol=1e-9)


@settings(max_examples=15)
@given(T_c=st.floats(270, 330))
def test_steady_states_at_an_input_stand_still(T_c):
    found = REACTOR.steady_states_at_input(T_c)
    assert len(found) in (1, 3)
    for x in found:
        np.testing.assert_allclose(REACTOR.f(x, np.array([T_c]), FEED), 0, atol=1e-6)


def test_with_the_printed_sign_c_a_is_95():
    """Deviation in `CSTR`: the paper's minus, by hand, leaves one steady state near 9.5."""
    p = CSTRParams()

    def imbalance(T):
        k = p.k_0 * np.exp(-p.E / (p.R * T))
        C_A = 10 / (1 + k)
        return 298.15 - T - p.H / p.rho_Cp * k * C_A - p.US_V / p.rho_Cp * (T - 298), C_A

    grid = np.linspace(250, 400, 20001)
    values = [imbalance(T) for T in grid]
    crossings = np.flatnonzero(np.diff(np.sign([v[0] for v in values])))
    assert len(crossings) == 1
    assert values[crossings[0]][1] == pytest.approx(9.5, abs=0.1)


@given(x=states, u=inputs)
def test_jacobians_of_the_cstr_agree_with_differences(x, u):
    J = REACTOR.jacobians(x, u, FEED)
    for i, h in enumerate((1e-4, 1e-6)):
        e = np.zeros(2)
        e[i] = h
        slope = (REACTOR.f(x + e, u, FEED) - REACTOR.f(x - e, u, FEED)) / (2 * h)
        np.testing.assert_allclose(J.A[:, i], slope, rtol=1e-5, atol=1e-5)
    slope = (REACTOR.f(x, u + 1e-3, FEED) - REACTOR.f(x, u - 1e-3, FEED)) / 2e-3
    np.testing.assert_allclose(J.B[:, 0], slope, rtol=1e-6)
    np.testing.assert_array_equal(J.C, np.eye(2))
    np.testing.assert_array_equal(J.D, 0)


@settings(max_examples=30, deadline=None)
@given(x=states, u=inputs, T_s=st.floats(0.25, 1.5))
def test_every_interval_agrees_with_dop853(x, u, T_s):
    precise = solve_ivp(
        lambda t, y: REACTOR.f(y, u, FEED), (0, T_s), x, method="DOP853", rtol=1e-13, atol=1e-13
    ).y[:, -1]
    ours = REACTOR.hold(x, u, FEED, np.array([T_s]))[0]
    np.testing.assert_allclose(ours[1], precise[1], atol=1e-6)
    np.testing.assert_allclose(ours[0], precise[0], rtol=1e-6)  # K, also in an explosion


@pytest.mark.parametrize("C_A", [0.0, 10.0, -1.0, np.nan, 1e-9])
def test_an_impossible_concentration_is_refused(C_A):
    with pytest.raises(PlantError, match="kgmol/m³"):
        REACTOR.steady_state_at_concentration(C_A)


@pytest.mark.parametrize("T_c", [0.0, -3.0, np.inf, np.nan])
def test_an_impossible_coolant_is_refused(T_c):
    with pytest.raises(PlantError, match="T_c must be positive"):
        REACTOR.steady_states_at_input(T_c)


def test_impossible_parameters_are_refused():
    with pytest.raises(PlantError, match="k_0 must be positive"):
        CSTRParams(k_0=-1)


def test_parameters_may_be_integers():
    whole = CSTRParams(**{f.name: int(getattr(CSTRParams(), f.name)) for f in fields(CSTRParams)})
    real = CSTRParams(**{f.name: float(getattr(whole, f.name)) for f in fields(CSTRParams)})
    x, u, times = np.array([311.0, 8.5]), np.array([298.0]), np.array([0.1])
    states = [CSTR(params).hold(x, u, FEED, times) for params in (whole, real)]
    assert np.isfinite(states[0]).all()
    np.testing.assert_array_equal(*states)


def test_there_are_derivatives_where_the_reaction_is_frozen():
    J = CSTR().jacobians(np.zeros(2), np.array([298.0]), FEED)
    assert J.A.tolist() == [[-1.3, 0.0], [0.0, -1.0]]  # flow and cooling alone


@given(st.floats(-5, 5), st.floats(-5, 5))
def test_analytic_code_is_differentiated_to_rounding(a, b):
    found = derivative(lambda p: [np.exp(p[0]) * p[1], p[0] ** 3], np.array([a, b]))
    exact = [[np.exp(a) * b, np.exp(a)], [3 * a**2, 0.0]]
    assert found == pytest.approx(np.array(exact), rel=1e-12, abs=1e-13)


@given(st.floats(0.1, 5))
def test_code_that_only_knows_floats_is_differentiated_by_differences(a):
    found = derivative(lambda p: [math.sin(p[0])], np.array([a]))
    assert found == pytest.approx(np.array([[math.cos(a)]]), abs=1e-10)


@pytest.mark.parametrize("x", [2.0, -2.0])
def test_code_that_swallows_the_complex_step_is_not_believed(x):
    # abs() of a complex number is real: the complex step alone would return 0.
    found = derivative(lambda p: [abs(p[0]) * 3 + np.maximum(p[0].real, 0)], np.array([x]))
    assert found == pytest.approx(np.array([[3 * np.sign(x) + (x > 0)]]), abs=1e-9)


def test_a_disturbance_of_an_output_is_added_to_it_and_changes_nothing_else():
    plant, x, u = CSTR(), np.array([320.0, 8.0]), np.array([299.0])
    d = np.append(FEED, 0.25)
    disturbed = Disturbed(plant, on_outputs=(1,))
    np.testing.assert_allclose(disturbed.g(x, u, d), [320.0, 8.25])
    np.testing.assert_array_equal(disturbed.f(x, u, d), plant.f(x, u, FEED))
    assert disturbed.disturbances[-1].name == "disturbance of concentration"


def test_a_disturbance_of_an_input_is_a_different_input():
    plant, x, u = Bicycle(), np.array([1.0, 0.5, 0.1]), np.array([14.0, 0.05])
    disturbed, w, times = Disturbed(plant, on_inputs=(1,)), np.array([0.02]), np.array([0.1, 0.2])
    penalized = u + np.array([0.0, 0.02])
    np.testing.assert_array_equal(
        disturbed.hold(x, u, w, times), plant.hold(x, penalized, np.zeros(0), times)
    )
    np.testing.assert_array_equal(
        disturbed.jacobians(x, u, w).B, plant.jacobians(x, penalized, np.zeros(0)).B
    )


@pytest.mark.parametrize("chosen", [{"on_outputs": (2,)}, {"on_outputs": (0, 0)}, {"on_inputs": (-1,)}])
def test_indices_that_are_none_are_refused(chosen):
    with pytest.raises(SettingsError, match="must be different indices below"):
        Disturbed(CSTR(), **chosen)


def test_a_copy_in_another_process_has_equations_of_its_own():
    disturbed = Disturbed(CSTR(), on_outputs=(1,))
    before = disturbed.equations
    copied = pickle.loads(pickle.dumps(disturbed))
    assert "equations" not in vars(copied)
    np.testing.assert_array_equal(copied.equations.on_outputs, before.on_outputs)


SETTINGS = MPCSettings(T_s=0.1, N_p=5, N_u=2, Q_y=[[1.0]], Q_du=[[0.1]])
HERE = Measurement(0.0, np.array([1.0]), np.zeros(1), np.zeros(0), np.zeros(1))


class Compiled(event.Listener):
    """What numba begins to compile."""

    def __init__(self):
        self.names = []

    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event):
        pass


def test_derivatives_of_a_compiled_equation_compile_nothing():
    # `max` of complex numbers does not compile, and numba would try it anew at each point.
    def f(x, u, d):
        return (u[0] - max(x[0], 0.0) ** 0.5,)

    plain, compiled = (
        FunctionPlant(each, states=[Channel("x")], inputs=[Channel("u")]) for each in (f, numba.njit(f))
    )
    with event.install_listener("numba:compile", found := Compiled()):
        J = compiled.jacobians(np.ones(1), np.ones(1), np.zeros(0))
    assert found.names == []
    assert np.array_equal(J.A, plain.jacobians(np.ones(1), np.ones(1), np.zeros(0)).A)
    assert pytest.approx(-0.5) == J.A


@numba.njit
def called(address, x, u, d, n):
    out = np.empty(n)
    call(address, x, u, d, np.zeros(0), out)
    return out


def plant(f):
    return FunctionPlant(f, states=[Channel("x")], inputs=[Channel("u")])


def test_a_python_method_gets_copies_and_its_result_arrives():
    callbacks = Callbacks(2, 1, 0)

    def method(x, u, d):
        assert d.shape == (0,)
        x *= 2
        return np.append(x, u)

    x = np.array([1.0, 3.0])
    out = called(callbacks.address(method, 3), x, np.array([5.0]), np.zeros(0), 3)
    np.testing.assert_array_equal(out, [2, 6, 5])
    np.testing.assert_array_equal(x, [1, 3])
    callbacks.check()


def test_what_a_method_raises_is_raised_by_the_next_check_and_only_once():
    callbacks = Callbacks(1, 1, 0)

    def method(x, u, d):
        raise KeyboardInterrupt

    address = callbacks.address(method, 1)
    assert np.isnan(called(address, np.zeros(1), np.zeros(1), np.zeros(0), 1)).all()
    with pytest.raises(KeyboardInterrupt):
        callbacks.check()
    callbacks.check()


def test_what_a_method_raises_in_one_thread_is_not_raised_in_another():
    callbacks, raised = Callbacks(1, 1, 0), []

    def method(x, u, d):
        raise ValueError

    def work():
        called(callbacks.address(method, 1), np.zeros(1), np.zeros(1), np.zeros(0), 1)
        begun.set()
        done.wait()
        with pytest.raises(ValueError):
            callbacks.check()
        raised.append(True)

    begun, done = threading.Event(), threading.Event()
    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    callbacks.check()
    done.set()
    thread.join()
    callbacks.check()
    assert raised


@pytest.mark.parametrize(
    ("errors", "states", "expected"),
    [
        ([ValueError], [1.0], None),
        ([ValueError], [np.nan], ValueError),
        ([ValueError, PlantError], [1.0], PlantError),
        ([ZeroDivisionError, KeyboardInterrupt], [1.0], KeyboardInterrupt),
    ],
)
def test_a_finite_simulation_raises_mistakes_and_interruptions_only(errors, states, expected):
    callbacks, left = Callbacks(1, 1, 0), list(errors)

    def method(x, u, d):
        raise left.pop(0)

    address = callbacks.address(method, 1)
    for _ in errors:
        called(address, np.zeros(1), np.zeros(1), np.zeros(0), 1)
    if expected is None:
        callbacks.check(np.array([states]))
    else:
        with pytest.raises(expected):
            callbacks.check(np.array([states]))
    callbacks.check()


@pytest.mark.parametrize(
    ("f", "error", "words"),
    [
        (lambda x, u, d: [math.sqrt(-1 - x[0] ** 2)], ValueError, r"math domain|nonnegative"),
        (lambda x, u, d: [x[0], u[0]], PlantError, "must return 1 values"),
    ],
)
def test_what_the_equations_raise_reaches_the_caller_of_the_mpc(f, error, words):
    with pytest.raises(error, match=words):
        LinearMPC(plant(f), SETTINGS).move(HERE)


def test_equations_cannot_be_pickled():
    with pytest.raises(TypeError, match="pickle the plant"):
        pickle.dumps(Bicycle().equations)


def test_a_model_that_is_not_finite_leaves_the_step_unsolved():
    move = LinearMPC(plant(lambda x, u, d: x * np.nan), SETTINGS).move(HERE)
    assert not move.solved
    np.testing.assert_array_equal(move.u, HERE.u)
