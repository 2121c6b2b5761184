import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents.surrogate import RADIAL_FUNCTIONS, Shape, Surrogate, squared_distances


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inverse_quadratic", 1 / (1 + 0.25)),
        ("gaussian", np.exp(-0.25)),
        ("thin_plate_spline", 0.25 * np.log(0.5)),
    ],
)
def test_values_at_one_half_are_those_of_the_formulas_after_eq_rbf(name, value):
    epsilon_d = 0.5
    assert RADIAL_FUNCTIONS[name].value(np.array(epsilon_d**2)) == pytest.approx(value)


@pytest.mark.parametrize("name", sorted(RADIAL_FUNCTIONS))
@given(u=st.floats(1e-3, 50))
def test_slopes_agree_with_differences(name, u):
    f, h = RADIAL_FUNCTIONS[name], 1e-6 * u
    difference = (f.value(np.array(u + h)) - f.value(np.array(u - h))) / (2 * h)
    assert f.slope(np.array(u)) == pytest.approx(difference, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("name", sorted(RADIAL_FUNCTIONS))
def test_values_and_slopes_are_finite_on_a_center(name):
    f = RADIAL_FUNCTIONS[name]
    assert np.isfinite(f.value(np.zeros(1))).all()
    assert np.isfinite(f.slope(np.zeros(1))).all()


def test_squared_distances_by_hand():
    d = squared_distances(np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([[3.0, 4.0]]))
    assert d.tolist() == [[25.0], [8.0]]


def test_squared_distances_of_close_points_keep_their_digits():
    a = np.array([[0.7, 0.3]])
    assert squared_distances(a, a + 1e-9)[0, 0] == pytest.approx(2e-18, rel=1e-6)


def test_eq_rbf_by_hand_with_the_squared_distance():
    # Distance 2 from the center: d = 4, ε d = 2, φ = 1 / (1 + 2²).
    surrogate = Surrogate(np.array([[0.0, 0.0]]), np.array([5.0]), Shape(0.5, (1.0, 1.0)))
    assert surrogate(np.array([[2.0, 0.0]])) == pytest.approx([1.0])


def test_a_knob_with_scale_two_counts_as_if_its_range_were_twice_as_wide():
    wide = Shape(0.7, (2.0, 0.5), "gaussian")
    plain = Shape(0.7, (1.0, 1.0), "gaussian")
    a, b = np.random.default_rng(0).random((2, 4, 2))
    assert wide.basis(a, b) == pytest.approx(plain.basis(a * [2, 0.5], b * [2, 0.5]))


def test_the_spread_is_the_range_over_the_samples():
    centers = np.array([[0.0], [1.0]])
    assert Surrogate(centers, np.array([2.0, 0.0]), Shape(1.0, (1.0,))).spread == 1.0
