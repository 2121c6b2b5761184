import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents.search import Acquisition, exploration, exploration_and_gradient
from prefcal_agents.surrogate import RADIAL_FUNCTIONS, Shape, Surrogate, squared_distances

SAMPLES = np.random.default_rng(0).random((7, 3))
coordinate = st.floats(0, 1)


def z_of(point):
    return exploration(squared_distances(np.atleast_2d(point), SAMPLES))


def test_idw_distance_is_zero_on_the_samples():
    assert z_of(SAMPLES).tolist() == [0.0] * 7


@given(st.tuples(coordinate, coordinate, coordinate))
def test_idw_distance_is_between_zero_and_a_quarter_turn(point):
    assert 0 <= z_of(np.array(point))[0] < np.pi / 2


def test_idw_distance_by_hand():
    # Two samples at squared distances 1 and 4: w = 1 and 1/16 (eq. IDW-distance).
    value = exploration(np.array([[1.0, 4.0]]))
    assert value[0] == pytest.approx(np.arctan(16 / 17))


@given(st.tuples(coordinate, coordinate, coordinate))
def test_gradient_of_the_idw_distance_agrees_with_differences(point):
    point = np.array(point)
    steps = 1e-6 * np.eye(3)
    differences = (z_of(point + steps) - z_of(point - steps)) / 2e-6
    value, slope = exploration_and_gradient(point, SAMPLES)
    assert value == pytest.approx(exploration(squared_distances(point[None], SAMPLES))[0])
    assert slope == pytest.approx(differences, rel=1e-4, abs=1e-6)


def test_gradient_of_the_idw_distance_is_finite_beside_and_on_a_sample():
    for offset in (0.0, 1e-160, 1e-80, 1e-12):
        assert np.isfinite(exploration_and_gradient(SAMPLES[0] + offset, SAMPLES)[1]).all()
        assert np.isfinite(z_of(SAMPLES[0] + offset)).all()


@pytest.mark.parametrize("rbf", sorted(RADIAL_FUNCTIONS))
@pytest.mark.parametrize("delta", [0.0, 0.7])
def test_gradient_of_the_acquisition_agrees_with_differences(rbf, delta):
    rng = np.random.default_rng(1)
    acquisition = Acquisition.of(
        Surrogate(SAMPLES, rng.standard_normal(7), Shape(1.3, (0.5, 2.0, 1.0), rbf)), delta
    )
    for point in rng.random((10, 3)):
        steps = 1e-6 * np.eye(3)
        differences = (acquisition(point + steps) - acquisition(point - steps)) / 2e-6
        value, slope = acquisition.value_and_gradient(point)
        assert value == pytest.approx(acquisition(point[None])[0])
        assert slope == pytest.approx(differences, rel=1e-4, abs=1e-6)


def test_acquisition_by_hand():
    # One center at 0 with weight 2, ε = 1: Ĵ = 2 / (1 + d²); the point lies at d = 1/4.
    surrogate = Surrogate(np.array([[0.0], [1.0]]), np.array([2.0, 0.0]), Shape(1.0, (1.0,)))
    acquisition = Acquisition.of(surrogate, 0.3)
    value, spread = 2 / (1 + 1 / 16), 2 - 1
    z = np.arctan(1 / (16 + 16))
    assert acquisition(np.array([[0.5]]))[0] == pytest.approx(value / spread - 0.3 * z)


def test_a_flat_surrogate_leaves_exploration_alone():
    flat = Acquisition.of(Surrogate(SAMPLES, np.zeros(7), Shape(1.0, (1.0,) * 3)), 0.3)
    assert flat(SAMPLES + 0.01) == pytest.approx(-0.3 * z_of(SAMPLES + 0.01))
