import numpy as np
import pytest

from prefcal_agents.models.surrogate import Shape, Surrogate


def test_eq_rbf_by_hand_with_the_squared_distance():
    # Distance 2 from the centre: d = 4, ε d = 2, φ = 1 / (1 + 2²).
    surrogate = Surrogate(np.array([[0.0, 0.0]]), np.array([5.0]), Shape(0.5, (1.0, 1.0)))
    assert surrogate(np.array([[2.0, 0.0]])) == pytest.approx([1.0])


def test_a_knob_with_scale_two_counts_as_if_its_range_were_twice_as_wide():
    wide = Shape(0.7, (2.0, 0.5), "gaussian")
    plain = Shape(0.7, (1.0, 1.0), "gaussian")
    a, b = np.random.default_rng(0).random((2, 4, 2))
    assert wide.basis(a, b) == pytest.approx(plain.basis(a * [2, 0.5], b * [2, 0.5]))


def test_the_spread_is_the_range_over_the_samples():
    centres = np.array([[0.0], [1.0]])
    assert Surrogate(centres, np.array([2.0, 0.0]), Shape(1.0, (1.0,))).spread == 1.0
