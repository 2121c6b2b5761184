from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.search import Domain, multistart
from prefcal_env.knobs import Knob, KnobSpace

REAL = KnobSpace([Knob(name, 0, 1, step=0) for name in "abc"])
MIXED = KnobSpace([Knob("a", 0, 1), Knob("b", 0, 4, integer=True), Knob("c", 0, 1)])


class Waves:
    """A bowl around `center` with waves on it; the lowest one is at the center."""

    def __init__(self, center):
        self.center = np.array(center)

    def __call__(self, z):
        away = z - self.center
        return np.sum(away**2 + 0.05 * (1 - np.cos(20 * away)), axis=1)

    def value_and_gradient(self, z):
        away = z - self.center
        return self(z[None])[0], 2 * away + np.sin(20 * away)


def domain(space, start=(0.5, 0.5, 0.5)):
    cube = (np.zeros(len(start)), np.ones(len(start)))
    return Domain(space.integers, lambda z: space.snap_all(z), np.array(start), cube)


@pytest.mark.parametrize("center", [(0.3, 0.8, 0.5), (0.0, 1.0, 0.9)])
def test_a_known_minimum_among_many_is_found(center):
    found = multistart(Waves(center), domain(REAL), np.random.default_rng(0))
    assert found[0] == pytest.approx(center, abs=2e-3)


def test_multistart_ends_exactly_where_the_gradient_is_zero():
    found = multistart(Waves((0.3, 0.8, 0.5)), domain(REAL), np.random.default_rng(0))
    assert found[0] == pytest.approx([0.3, 0.8, 0.5], abs=1e-6)


def test_integer_knobs_stay_on_their_grid():
    found = multistart(Waves((0.3, 0.8, 0.5)), domain(MIXED), np.random.default_rng(0))
    assert set(found[:, 1]) <= {0.0, 0.25, 0.5, 0.75, 1.0}
    assert found[0] == pytest.approx([0.3, 0.75, 0.5], abs=2e-3)


def test_points_come_in_increasing_order_and_stay_in_the_cube():
    waves = Waves((1.2, -0.3, 0.5))
    found = multistart(waves, domain(REAL, (1.0, 0.0, 0.0)), np.random.default_rng(0))
    assert np.all(np.diff(waves(found)) >= 0)
    assert np.all((found >= 0) & (found <= 1))


def test_the_same_generator_gives_the_same_points():
    runs = [multistart(Waves((0.3, 0.8, 0.5)), domain(REAL), np.random.default_rng(7)) for _ in "ab"]
    assert np.array_equal(*runs)


def test_nothing_outside_the_box_is_looked_at():
    low, high = np.array([0.4, 0.0, 0.6]), np.array([0.7, 0.1, 0.9])
    inside = replace(domain(REAL, (0.5, 0.05, 0.7)), corners=(low, high))
    waves = Waves((0.3, 0.8, 0.75))
    found = multistart(waves, inside, np.random.default_rng(0))
    assert np.all((found >= low) & (found <= high))
    assert waves(found[:1])[0] <= waves(np.array([[0.4, 0.1, 0.75]]))[0] + 0.02
