"""Plants out of equations alone, and the one integrator that simulates every plant."""

import math
import time

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import DOP853, solve_ivp

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants import FunctionPlant
from prefcal_env.plants._dop853 import TABLE
from prefcal_env.plants.cstr import CSTR, FEED
from prefcal_env.plants.plant import Callbacks, Equations, integrate
from support.equations import evaluated

NONE = np.zeros(0)
U = np.ones(1)


def simulated(f, x, times, max_step=np.inf):
    """Return the states and the number of evaluations of ẋ."""
    evaluations = []

    def counted(x, u, d):
        evaluations.append(1)
        return f(x)

    callbacks = Callbacks(len(x), 1, 0)
    equations = Equations(callbacks.address(counted, len(x)), 0, 0, callbacks=callbacks)
    with np.errstate(all="ignore"):
        states = integrate(equations, np.array(x, float), U, NONE, np.array(times, float), max_step)
    callbacks.check()
    return states, len(evaluations)


def precise(f, x, times, method="DOP853"):
    rtol = 1e-13 if method == "DOP853" else 1e-11
    return np.array(
        [solve_ivp(lambda t, x: f(x), (0, t), x, method, rtol=rtol, atol=1e-14).y[:, -1] for t in times]
    )


def pendulum(x):
    return [x[1], -9.81 * np.sin(x[0]) - 0.1 * x[1] + 1]


def lorenz(x):
    return [10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]]


def orbit(x):
    return [x[2], x[3], *(-x[:2] / np.hypot(x[0], x[1]) ** 3)]


def robertson(x):
    slow, fast = 0.04 * x[0] - 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
    return [-slow, slow - fast, fast]


def van_der_pol(x):
    return [x[1], 1e4 * (1 - x[0] ** 2) * x[1] - x[0]]


def test_the_coefficients_are_those_of_scipy():
    table = np.zeros((22, 16))
    table[:12, :12], table[12, :12], table[13:16] = DOP853.A, DOP853.B, DOP853.A_EXTRA
    table[16, :13], table[17, :13], table[18:] = DOP853.E5, DOP853.E3, DOP853.D
    np.testing.assert_array_equal(TABLE, table)


@pytest.mark.parametrize(
    ("f", "x"),
    [
        (pendulum, [0.5, 0.0]),
        (lorenz, [1.0, 2.0, 20.0]),
        (orbit, [1.0, 0.0, 0.0, 1.2]),
        (lambda x: [0.0, -x[1]], [0.0, 1.0]),
    ],
)
def test_ends_and_instants_between_them_are_precise(f, x):
    times = [0.01, 0.3, 0.31, 1.0, 2.0]
    states, _ = simulated(f, x, times)
    np.testing.assert_allclose(states, precise(f, np.array(x), times), rtol=1e-8, atol=1e-9)


def test_other_instants_change_nothing_but_the_last_digits():
    many, _ = simulated(pendulum, [0.5, 0.0], np.linspace(0.001, 3.0, 3000))
    one, _ = simulated(pendulum, [0.5, 0.0], [3.0])
    np.testing.assert_allclose(many[-1], one[0], rtol=1e-12)


def test_the_same_call_gives_the_same_bits():
    runs = [simulated(lorenz, [1.0, 2.0, 20.0], [1.0, 5.0])[0] for _ in range(2)]
    np.testing.assert_array_equal(*runs)


def test_no_instant_is_no_state():
    states, _ = simulated(pendulum, [0.5, 0.0], [])
    assert states.shape == (0, 2)


def test_read_only_arrays_stay_as_they_are():
    plant, x, u, times = CSTR(), np.array([311.0, 8.5]), np.array([298.0]), np.array([0.1, 0.2])
    for array in (x, u, times):
        array.setflags(write=False)
    integrate(plant.equations, x, u, FEED, times)
    assert x.tolist() == [311.0, 8.5]


@pytest.mark.parametrize(
    ("f", "until"),
    [
        (lambda x: x**2, 1.0),
        (lambda x: x**3, 0.5),
        (lambda x: np.exp(x), np.exp(-1)),
        (lambda x: [np.nan], 0.0),
        (lambda x: [np.inf], 0.0),
        (lambda x: np.sqrt(2 - x) - 2, np.inf),
    ],
)
def test_after_a_blow_up_there_is_no_number(f, until):
    times = np.linspace(0.03, 3.03, 61)
    states, evaluations = simulated(f, [1.0], times)
    np.testing.assert_array_equal(np.isfinite(states[:, 0]), times < until)
    assert evaluations < 20_000


@pytest.mark.parametrize(
    ("f", "x", "T", "method"),
    [
        (lambda x: [-1e5 * (x[0] - x[1]), -x[1]], [0.0, 1.0], 3.0, "Radau"),
        (robertson, [1.0, 0.0, 0.0], 1e4, "Radau"),
        (van_der_pol, [2.0, 0.0], 2e4, "Radau"),
    ],
)
def test_stiff_plants_take_few_evaluations(f, x, T, method):
    started = time.process_time()
    states, evaluations = simulated(f, x, [0.3 * T, T])
    assert evaluations < 10_000
    assert time.process_time() - started < 5
    exact = solve_ivp(lambda t, x: f(x), (0, T), x, method, [0.3 * T, T], rtol=1e-10, atol=1e-13).y.T
    np.testing.assert_allclose(states, exact, rtol=1e-5)


def test_a_long_oscillation_is_not_taken_for_stiff():
    states, _ = simulated(lambda x: [x[1], -x[0]], [1.0, 0.0], [2000.0])
    np.testing.assert_allclose(states[0], [np.cos(2000), -np.sin(2000)], atol=1e-6)


def test_dry_friction_ends_soon_and_sticks():
    states, evaluations = simulated(lambda x: [-np.sign(x[0])], [0.5], [0.25, 0.5, 1.0])
    np.testing.assert_allclose(states[:, 0], [0.25, 0.0, 0.0], atol=1e-3)
    assert evaluations < 40_000


@pytest.mark.parametrize("T", [0.1, 1.0])
@pytest.mark.parametrize("M", [3, 30, 300, 584, 1000, 10_000])
def test_a_strong_brake_stops_the_motor_and_holds_it(M, T):
    states, evaluations = simulated(lambda x: [x[1], M * (0.05 - np.sign(x[1]))], [0, M * T / 2], [T])
    distance = (M * T / 2) ** 2 / (2 * 0.95 * M)  # then it sticks
    assert states[0, 0] == pytest.approx(distance, rel=1e-2)
    assert states[0, 1] == pytest.approx(0, abs=1e-2 * M * T / 2)
    assert evaluations < 80_000


@pytest.mark.parametrize("T", [1.0, 3.0])
@pytest.mark.parametrize("u", [0.0, 1.0, 3.0])
def test_a_relay_slides_along_its_switching_line(T, u):
    def f(x):
        return np.array([x[1], -5 * np.sign(x[1] + x[0]) + u])

    x, h = np.array([1.0, 0.0]), T / 20_000
    for _ in range(20_000):
        x = x + h * f(x + h / 2 * f(x))
    states, evaluations = simulated(f, [1.0, 0.0], [T])
    np.testing.assert_allclose(states[0], x, atol=2e-2)
    assert evaluations < 80_000


@pytest.mark.parametrize("T", [1.0, 3.0, 10.0])
def test_a_tank_empties_and_stays_empty(T):
    states, evaluations = simulated(lambda x: -np.sign(x) * np.sqrt(abs(x)), [1.0], [T])
    assert states[0, 0] == pytest.approx(max(1 - T / 2, 0) ** 2, abs=1e-4)
    assert evaluations < 80_000


def test_what_is_too_fast_for_the_interval_has_no_number():
    states, evaluations = simulated(lambda x: [x[1], -x[0]], [1.0, 0.0], [1e6])
    assert np.isnan(states).all()
    assert evaluations < 40_000


def test_a_step_to_where_the_equations_are_not_finite_is_repeated():
    states, _ = simulated(lambda x: [-np.sqrt(x[0]), 1.0], [1.0, 0.0], [1.9, 1.9999])
    np.testing.assert_allclose(states[:, 0], [0.05**2, 0.00005**2], rtol=1e-6, atol=1e-12)


def test_the_largest_step_holds_for_stiff_plants_too():
    def bump(x):
        return [1.0, np.exp(-(((x[0] - 7.3) / 0.02) ** 2)), 1e6 * (x[1] - x[2])]

    states, evaluations = simulated(bump, [0.0, 0.0, 0.0], [10.0], max_step=0.01)
    np.testing.assert_allclose(states[0, 1:], 0.02 * np.sqrt(np.pi), rtol=1e-4)
    assert evaluations < 20_000


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0, 1.0]])
def test_at_the_start_the_state_is_the_first_one(times):
    states, _ = simulated(lambda x: [1.0], [2.0], times)
    np.testing.assert_allclose(states[:, 0], 2 + np.array(times), rtol=1e-14)


def test_largest_steps_that_do_not_quite_fill_the_interval_reach_its_end():
    ends = np.arange(1, 40) / 10
    states = [simulated(lambda x: [1.0], [0.0], [T], max_step=0.1)[0][0, 0] for T in ends]
    np.testing.assert_allclose(states, ends, rtol=1e-12)


def test_no_step_is_longer_than_the_largest():
    def bump(x):  # a peak of width 0.01 that a long step would miss
        return [1.0, np.exp(-(((x[0] - 0.7) / 0.01) ** 2))]

    states, _ = simulated(bump, [0.0, 0.0], [2.0], max_step=0.02)
    assert states[0, 1] == pytest.approx(0.01 * np.sqrt(np.pi), rel=1e-6)


def test_what_interrupts_the_equations_passes():
    def interrupted(x):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulated(interrupted, [1.0], [1.0])


@pytest.mark.parametrize(
    ("x", "u", "T"), [([400.0, 9.95], 310.0, 0.05), ([356.0, 9.0], 310.0, 0.25), ([311.0, 8.5], 298.0, 1.5)]
)
def test_the_reactor_is_precise_even_when_it_runs_away(x, u, T):
    plant, x, u = CSTR(), np.array(x), np.array([u])
    times = np.linspace(T / 7, T, 7)
    states = integrate(plant.equations, x, u, FEED, times)
    exact = precise(lambda x: plant.f(x, u, FEED), x, times)
    np.testing.assert_allclose(states, exact, rtol=3e-9)


X = (Channel("angle", "rad"), Channel("speed", "rad/s"))
TORQUE = (Channel("torque", "Nm", low=-2.0, high=2.0),)


def driven_pendulum(x, u, d):
    return [x[1], -9.81 * np.sin(x[0]) - 0.1 * x[1] + u[0]]


PENDULUM = FunctionPlant(driven_pendulum, states=X, inputs=TORQUE)


def test_without_g_the_states_are_the_outputs():
    assert PENDULUM.outputs == X
    assert np.array_equal(PENDULUM.g(np.array([1.0, 2.0]), np.zeros(1), NONE), [1.0, 2.0])


@given(x=st.tuples(st.floats(-3, 3), st.floats(-5, 5)), u=st.floats(-2, 2))
def test_jacobians_are_those_by_hand(x, u):
    J = PENDULUM.jacobians(np.array(x), np.array([u]), NONE)
    np.testing.assert_allclose(J.A, np.array([[0, 1], [-9.81 * np.cos(x[0]), -0.1]]), atol=1e-12)
    np.testing.assert_allclose(J.B, np.array([[0.0], [1.0]]), atol=1e-12)
    np.testing.assert_allclose(J.C, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(J.D, np.zeros((2, 1)), atol=1e-12)


@pytest.mark.parametrize(
    "f",
    [
        lambda x, u, d: [x[0] ** 2],  # overflows
        lambda x, u, d: [float(x[0]) ** 3],  # raises OverflowError
        lambda x, u, d: [1 / (2 - float(x[0])) ** 2],  # a singularity on the way
        lambda x, u, d: [float(x[0]) / int(x[0] < 1.5)],  # raises ZeroDivisionError
    ],
)
def test_a_state_that_blows_up_is_not_an_error(f):
    plant = FunctionPlant(f, states=X[:1], inputs=TORQUE)
    states = plant.hold(np.ones(1), np.zeros(1), NONE, np.linspace(0.1, 3, 30))
    assert np.isfinite(states[0]).all()


def test_equations_that_return_the_wrong_number_are_refused():
    plant = FunctionPlant(
        lambda x, u, d: [0.0], lambda x, u, d: 1.0, states=X, inputs=TORQUE, outputs=X[:1], name="pendulum"
    )
    x, u = np.zeros(2), np.zeros(1)
    with pytest.raises(PlantError, match=r"f of plant 'pendulum' must return 2 values.*\(1,\)"):
        plant.f(x, u, NONE)
    with pytest.raises(PlantError, match=r"g of plant 'pendulum' must return 1 values.*\(\)"):
        plant.g(x, u, NONE)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"states": ()}, "at least one state and one input"),
        ({"inputs": ()}, "at least one state and one input"),
        ({"outputs": X}, "both g and its outputs"),
        ({"g": lambda x, u, d: x}, "both g and its outputs"),
        ({"max_step": 0.0}, "max_step must be positive"),
        ({"max_step": np.nan}, "max_step must be positive"),
    ],
)
def test_an_incomplete_plant_is_refused(change, reason):
    with pytest.raises(PlantError, match=reason):
        FunctionPlant(**{"f": driven_pendulum, "states": X, "inputs": TORQUE} | change)


def test_compiled_equations_give_the_same_states_and_jacobians():
    f = numba.njit(lambda x, u, d: (x[1], -9.81 * np.sin(x[0]) - 0.1 * x[1] + u[0]))
    plant = FunctionPlant(f, states=X, inputs=TORQUE)
    x, u, times = np.array([0.5, 0.0]), np.array([1.0]), np.array([0.3, 1.0, 2.5])
    np.testing.assert_allclose(plant.hold(x, u, NONE, times), PENDULUM.hold(x, u, NONE, times), rtol=1e-12)
    J = PENDULUM.jacobians(x, u, NONE)
    found = evaluated(plant.equations, "jacobians", 12, x, u, NONE)
    np.testing.assert_allclose(found, np.concatenate([m.ravel() for m in (J.A, J.B, J.C, J.D)]), atol=1e-11)
    np.testing.assert_allclose(plant.jacobians(x, u, NONE).A, J.A, atol=1e-11)


def test_compiled_equations_that_return_the_wrong_number_are_refused():
    plant = FunctionPlant(numba.njit(lambda x, u, d: (x[0],)), states=X, inputs=TORQUE)
    with pytest.raises(PlantError, match="must return 2 values"):
        plant.hold(np.ones(2), np.ones(1), NONE, np.ones(1))


def test_a_compiled_division_by_zero_is_not_an_error():
    plant = FunctionPlant(numba.njit(lambda x, u, d: (1 / (x[0] - x[0]),)), states=X[:1], inputs=TORQUE)
    assert np.isnan(plant.hold(np.ones(1), np.ones(1), NONE, np.ones(1))).all()


def test_a_state_outside_of_the_domain_is_an_error():
    plant = FunctionPlant(lambda x, u, d: [-1 - math.sqrt(x[0])], states=X[:1], inputs=TORQUE)
    with pytest.raises(ValueError, match=r"math domain|nonnegative"):
        plant.hold(np.ones(1), np.zeros(1), NONE, np.array([3.0]))
    assert np.isfinite(plant.hold(np.ones(1), np.zeros(1), NONE, np.array([0.1]))).all()


def test_compiled_equations_may_write_into_their_arguments():
    def f(x, u, d):
        x *= -1
        u += 1
        return (x[1], -x[0])

    x, u, times = np.ones(2), np.ones(1), np.array([1.0])
    states = FunctionPlant(numba.njit(f), states=X, inputs=TORQUE).hold(x, u, NONE, times)
    python = FunctionPlant(f, states=X, inputs=TORQUE).hold(x, u, NONE, times)
    np.testing.assert_allclose(states, python, rtol=1e-12)


@pytest.mark.parametrize("f", [lambda x, u, d: (x[1], 1), lambda x, u, d: "ab"])
def test_compiled_equations_that_return_no_floats_are_refused_in_one_line(f):
    plant = FunctionPlant(numba.njit(f), states=X, inputs=TORQUE)
    with pytest.raises(PlantError, match=r"write 1\.0, not 1") as caught:
        plant.hold(np.ones(2), np.ones(1), NONE, np.ones(1))
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)
