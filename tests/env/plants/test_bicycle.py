"""The bicycle is eq. nonlin_bicyclemodel, and its hold is exact."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from prefcal_env.errors import PlantError
from prefcal_env.plants.bicycle import Bicycle

PLANT, NONE = Bicycle(), np.zeros(0)
states = st.tuples(st.floats(-50, 50), st.floats(-5, 5), st.floats(-1, 1)).map(np.array)
inputs = st.tuples(st.floats(0, 20), st.floats(-pi / 4, pi / 4)).map(np.array)


@given(x=states, u=inputs, T=st.floats(0.01, 2))
def test_the_hold_is_exact(x, u, T):
    precise = solve_ivp(
        lambda t, y: PLANT.f(y, u, NONE), (0, T), x, method="DOP853", rtol=1e-13, atol=1e-13
    ).y[:, -1]
    np.testing.assert_allclose(PLANT.hold(x, u, NONE, np.array([T]))[0], precise, atol=1e-9)


def test_left_is_positive():
    x = PLANT.hold(np.zeros(3), np.array([10.0, 0.1]), NONE, np.array([1.0]))[0]
    assert x[1] > 0
    assert x[2] > 0


@given(x=states, u=inputs)
def test_jacobians_agree_with_differences(x, u):
    J, h = PLANT.jacobians(x, u, NONE), 1e-6
    for i in range(3):
        e = h * np.eye(3)[i]
        slope = (PLANT.f(x + e, u, NONE) - PLANT.f(x - e, u, NONE)) / (2 * h)
        np.testing.assert_allclose(J.A[:, i], slope, atol=1e-6)
    for i in range(2):
        e = h * np.eye(2)[i]
        slope = (PLANT.f(x, u + e, NONE) - PLANT.f(x, u - e, NONE)) / (2 * h)
        np.testing.assert_allclose(J.B[:, i], slope, atol=1e-6)


@pytest.mark.parametrize("length", [0.0, -4.5, np.inf, np.nan])
def test_an_impossible_length_is_refused(length):
    with pytest.raises(PlantError, match="length L"):
        Bicycle(length)
