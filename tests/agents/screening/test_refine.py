"""Where to simulate next: near the leaders."""

import numpy as np
import pytest

from contracts.agents import HALF, MIXED, RARE, RING
from prefcal_agents.screening.growth import near_leaders
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.space.feasible import Region
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from support.simulated import SQUARE

PART = MIXED.narrowed({"gain": (0.1, 0.2), "horizon": (4, 6)})
FROZEN = MIXED.narrowed({"weight": (0.31, 0.31)})
CUBE = KnobSpace([Knob(name, 0.0, 1.0) for name in "abc"])


def near(space, costs=None, count=60, seed=0, z=None):
    """Points near the leaders of `costs` of a start that fills the space, and that start."""
    z = latin_hypercube(space, 80, 1) if z is None else z
    rng = np.random.default_rng(seed)
    costs = rng.random((8, len(z))) if costs is None else costs(z)
    return near_leaders(space, z, costs, count, rng), z


@pytest.mark.parametrize("space", [MIXED, PART, FROZEN, HALF, RING, RARE], ids="mpfhrx")
def test_points_are_inside_what_is_searched_and_allowed(space):
    points, _ = near(space)
    low, high = space.corners
    assert points.shape == (60, 3)
    assert np.all((points >= low) & (points <= high))
    assert Region(space).allows(points).all()  # θ that rounding takes over an edge: `Growth`


def test_points_are_near_those_that_lead():
    goal = np.array([0.3, 0.6, 0.7])
    z = latin_hypercube(CUBE, 400, 1)
    points, _ = near(CUBE, lambda z: np.linalg.norm(z - goal, axis=1)[None], 200, z=z)
    apart, before = (np.linalg.norm(p - goal, axis=1) for p in (points, z))
    assert np.median(apart) < np.quantile(before, 0.1)
    assert np.mean(apart < np.sort(before)[2]) > 0.05  # some are better than all but two


def test_each_draw_has_leaders_of_its_own():
    goals = np.array([[0.2, 0.2], [0.8, 0.8]])
    z = latin_hypercube(SQUARE, 400, 1)
    costs = np.linalg.norm(z[None] - goals[:, None], axis=2)
    points = near_leaders(SQUARE, z, costs, 300, np.random.default_rng(0))
    apart = np.linalg.norm(points[None] - goals[:, None], axis=2)
    assert np.all(np.mean(apart < 0.2, axis=1) > 0.35)
    assert np.mean(apart.min(axis=0) < 0.25) > 0.9


def test_steps_shrink_as_the_leaders_agree():
    rng, goal = np.random.default_rng(0), np.full(3, 0.5)
    spread = []
    for width in (0.4, 0.04):
        z = goal + width * (rng.random((50, 3)) - 0.5)
        points, _ = near(CUBE, lambda z: rng.random((8, len(z))), 200, z=z)
        spread.append(points.std(axis=0).mean())
    assert spread[1] < 0.3 * spread[0]


def test_leaders_that_are_all_the_same_are_left_by_a_small_step():
    z = np.full((1, 3), 0.5)
    points, _ = near(CUBE, lambda z: np.zeros((2, 1)), 100, z=z)
    assert np.abs(points - 0.5).max() < 0.06
    assert points.std(axis=0) == pytest.approx(np.full(3, 0.01), rel=0.3)


def test_the_same_seed_gives_the_same_points():
    (one, _), (same, _), (other, _) = (near(HALF, seed=seed) for seed in (4, 4, 5))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
