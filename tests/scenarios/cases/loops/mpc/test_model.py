"""The model of the MPC is the undisturbed plant."""

import numpy as np
import pytest

from prefcal_env.plants.derivative import derivative
from prefcal_scenarios.cases.loops import LOOPS
from prefcal_scenarios.cases.loops.mpc.model import Model
from support.equations import evaluated

NONE = np.zeros(0)


@pytest.mark.parametrize("name", LOOPS)
def test_it_rests_where_the_loop_starts_and_holds_like_the_plant(name):
    course = LOOPS[name]()._course(1, 0)
    model, at = Model(course), course.at
    assert model.f(at.x, at.u, NONE) == pytest.approx(np.zeros(len(at.x)), abs=1e-9)
    assert (model.g(at.x, at.u, NONE) == at.x[course.measured]).all()
    times = course.step * np.array([1.0, 2.5, 6.0])
    resting = model.hold(at.x, at.u, NONE, times)
    assert resting == pytest.approx(np.tile(at.x, (3, 1)), abs=1e-9)


@pytest.mark.parametrize("name", LOOPS)
def test_its_compiled_equations_are_its_own(name):
    course = LOOPS[name]()._course(1, 0)
    model, x, u = Model(course), course.at.x + 0.1, course.at.u
    J = model.jacobians(x, u, NONE)
    matrices = np.concatenate([m.ravel() for m in (J.A, J.B, J.C, J.D)])
    for equation, values in (
        ("f", model.f(x, u, NONE)), ("g", model.g(x, u, NONE)), ("jacobians", matrices),
    ):  # fmt: skip
        found = evaluated(model.equations, equation, len(values), x, u, NONE)
        np.testing.assert_array_equal(found, values)


def test_its_jacobians_are_those_of_the_equations():
    course = LOOPS["boost-converter"]()._course(1, 0)
    L, C, R, supply, r = 0.2, 0.47, 12.0, 12.0, 0.15
    point = np.array([20.0, 3.0, 0.4])

    def f(p):
        return np.array(
            [((1 - p[2]) * p[1] - p[0] / R) / C, (supply - r * p[1] - (1 - p[2]) * p[0]) / L]
        )

    J = Model(course).jacobians(point[:2], point[2:], NONE)
    exact = derivative(f, point)
    np.testing.assert_allclose(np.hstack([J.A, J.B]), exact, atol=1e-7)


def test_a_read_only_state_is_not_changed():
    course = LOOPS["tank"]()._course(1, 0)
    x = course.at.x.copy()
    x.setflags(write=False)
    Model(course).jacobians(x, course.at.u, NONE)
    assert (x == course.at.x).all()
