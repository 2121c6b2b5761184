"""Derivatives of code: exact where it is analytic, and never silently wrong."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.plants.jacobians import derivative


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
