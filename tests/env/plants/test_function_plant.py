"""A plant from its equations alone."""

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants import FunctionPlant
from support.equations import evaluated

X = (Channel("angle", "rad"), Channel("speed", "rad/s"))
U = (Channel("torque", "Nm", low=-2.0, high=2.0),)


def pendulum(x, u, d):
    return [x[1], -9.81 * np.sin(x[0]) - 0.1 * x[1] + u[0]]


PENDULUM = FunctionPlant(pendulum, states=X, inputs=U)
NONE = np.zeros(0)


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
    plant = FunctionPlant(f, states=X[:1], inputs=U)
    states = plant.hold(np.ones(1), np.zeros(1), NONE, np.linspace(0.1, 3, 30))
    assert np.isfinite(states[0]).all()


def test_equations_that_return_the_wrong_number_are_refused():
    plant = FunctionPlant(
        lambda x, u, d: [0.0], lambda x, u, d: 1.0, states=X, inputs=U, outputs=X[:1], name="pendulum"
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
        FunctionPlant(**{"f": pendulum, "states": X, "inputs": U} | change)


def test_compiled_equations_give_the_same_states_and_jacobians():
    f = numba.njit(lambda x, u, d: (x[1], -9.81 * np.sin(x[0]) - 0.1 * x[1] + u[0]))
    plant = FunctionPlant(f, states=X, inputs=U)
    x, u, times = np.array([0.5, 0.0]), np.array([1.0]), np.array([0.3, 1.0, 2.5])
    np.testing.assert_allclose(plant.hold(x, u, NONE, times), PENDULUM.hold(x, u, NONE, times), rtol=1e-12)
    J = PENDULUM.jacobians(x, u, NONE)
    found = evaluated(plant.equations, "jacobians", 12, x, u, NONE)
    np.testing.assert_allclose(found, np.concatenate([m.ravel() for m in (J.A, J.B, J.C, J.D)]), atol=1e-11)
    np.testing.assert_allclose(plant.jacobians(x, u, NONE).A, J.A, atol=1e-11)


def test_compiled_equations_that_return_the_wrong_number_are_refused():
    plant = FunctionPlant(numba.njit(lambda x, u, d: (x[0],)), states=X, inputs=U)
    with pytest.raises(PlantError, match="must return 2 values"):
        plant.hold(np.ones(2), np.ones(1), NONE, np.ones(1))


def test_a_compiled_division_by_zero_is_not_an_error():
    plant = FunctionPlant(numba.njit(lambda x, u, d: (1 / (x[0] - x[0]),)), states=X[:1], inputs=U)
    assert np.isnan(plant.hold(np.ones(1), np.ones(1), NONE, np.ones(1))).all()


def test_a_state_outside_of_the_domain_is_an_error():
    plant = FunctionPlant(lambda x, u, d: [-1 - math.sqrt(x[0])], states=X[:1], inputs=U)
    with pytest.raises(ValueError, match=r"math domain|nonnegative"):
        plant.hold(np.ones(1), np.zeros(1), NONE, np.array([3.0]))
    assert np.isfinite(plant.hold(np.ones(1), np.zeros(1), NONE, np.array([0.1]))).all()


def test_compiled_equations_may_write_into_their_arguments():
    def f(x, u, d):
        x *= -1
        u += 1
        return (x[1], -x[0])

    x, u, times = np.ones(2), np.ones(1), np.array([1.0])
    states = FunctionPlant(numba.njit(f), states=X, inputs=U).hold(x, u, NONE, times)
    python = FunctionPlant(f, states=X, inputs=U).hold(x, u, NONE, times)
    np.testing.assert_allclose(states, python, rtol=1e-12)


@pytest.mark.parametrize("f", [lambda x, u, d: (x[1], 1), lambda x, u, d: "ab"])
def test_compiled_equations_that_return_no_floats_are_refused_in_one_line(f):
    plant = FunctionPlant(numba.njit(f), states=X, inputs=U)
    with pytest.raises(PlantError, match=r"write 1\.0, not 1") as caught:
        plant.hold(np.ones(2), np.ones(1), NONE, np.ones(1))
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)
