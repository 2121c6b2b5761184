"""CasADi functions as equations of a plant."""

import pickle

import numpy as np
import pytest

from prefcal_env import Channel, FunctionPlant
from prefcal_env.errors import PlantError

ca = pytest.importorskip("casadi")
STATES, INPUTS = [Channel("angle"), Channel("speed")], [Channel("torque", "", -1, 1)]
X, U, NONE = np.array([0.3, -0.2]), np.array([0.5]), np.zeros(0)


def function(n_x=2, kind=None):
    kind = kind or ca.SX
    x, u = kind.sym("x", n_x), kind.sym("u")
    return ca.Function("f", [x, u], [ca.vertcat(x[1], ca.sin(x[0]) + u * x[1])])


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_a_casadi_plant_is_that_of_numpy_with_exact_derivatives(kind):
    plant = FunctionPlant(function(kind=kind), states=STATES, inputs=INPUTS)
    same = FunctionPlant(lambda x, u, d: [x[1], np.sin(x[0]) + u[0] * x[1]], states=STATES, inputs=INPUTS)
    assert plant.f(X, U, NONE) == pytest.approx(same.f(X, U, NONE), rel=1e-15)
    J = plant.jacobians(X, U, NONE)
    assert pytest.approx(np.array([[0, 1], [np.cos(0.3), 0.5]]), rel=1e-15) == J.A
    assert pytest.approx(np.array([[0.0], [-0.2]]), rel=1e-15) == J.B
    times = np.array([0.1, 2.0])
    assert plant.hold(X, U, NONE, times) == pytest.approx(same.hold(X, U, NONE, times), abs=1e-9)


def test_values_are_copies_and_a_plant_survives_pickling():
    plant = FunctionPlant(function(), states=STATES, inputs=INPUTS)
    first = plant.f(X, U, NONE)
    kept = first.copy()
    plant.f(2 * X, U, NONE)
    assert np.array_equal(first, kept)
    again = pickle.loads(pickle.dumps(plant))
    assert np.array_equal(again.f(X, U, NONE), kept)


def test_a_function_of_other_sizes_or_with_free_variables_is_refused():
    with pytest.raises(PlantError, match="inputs x of 2"):
        FunctionPlant(function(3), states=STATES, inputs=INPUTS)
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
    free = ca.Function("f", [x, u], [x * p], {"allow_free": True})
    with pytest.raises(PlantError, match="free variables"):
        FunctionPlant(free, states=STATES, inputs=INPUTS)
