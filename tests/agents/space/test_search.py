"""The first samples, what is allowed, and the search for the next: exploration and IDW."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import check_grad
from scipy.stats import qmc

from prefcal_agents.baselines import ValueAcquisition, Weights, interpolate
from prefcal_agents.search import (
    Acquisition,
    Domain,
    Region,
    Tried,
    capacity,
    exploration,
    exploration_and_gradient,
    latin_hypercube,
    multistart,
    random_points,
)
from prefcal_agents.surrogate import RADIAL_FUNCTIONS, Shape, Surrogate, squared_distances
from prefcal_env import Constraint, Knob, KnobSpace, LinearConstraint
from prefcal_env.errors import KnobError, ProtocolError
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History, Sample
from support.histories import in_cube

SPACE = KnobSpace(
    [
        Knob("real", 2.0, 5.0, step=0),
        Knob("count", 3, 17, integer=True),
        Knob("decades", 1, 5000, scale="log10", integer=True),
    ]
)
GRID = KnobSpace([Knob("a", 0, 2, integer=True), Knob("b", 0, 1, integer=True)])


@pytest.mark.parametrize(("count", "seed"), [(1, 0), (6, 0), (25, 7)])
def test_the_points_are_those_of_scipy(count, seed):
    sampler = qmc.LatinHypercube(len(SPACE), rng=np.random.default_rng([seed, 0]))
    assert np.array_equal(latin_hypercube(SPACE, count, seed), SPACE.scaled(sampler.random(count)))


def test_capacity_counts_theta():
    assert capacity(GRID) == 6
    assert capacity(SPACE) == np.inf
    assert capacity(KnobSpace([Knob("x", 0, 1, step=0.3), *GRID])) == 6 * 4  # 0, 0.3, 0.6, 0.9
    assert capacity(KnobSpace([Knob("x", 0, 1)], within={"x": (0.2, 0.3)})) == 11


def tried(*points):
    book = History()
    for z in points:
        book = book.with_pending(Sample.of(GRID, np.array(z))).with_answer(Answer(0), book.incumbent)
    return Tried(GRID, book)


def test_two_points_of_one_theta_count_as_one():
    seen = tried((0.0, 0.0))
    assert not seen.may_run(np.array([0.2, 0.4]))
    assert seen.may_run(np.array([0.3, 0.4]))


def test_a_fresh_point_is_taken_as_it_is_and_a_tried_one_replaced():
    rng = np.random.default_rng(0)
    seen = tried((0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 1.0))
    assert seen.fresh(np.array([0.9, 0.9]), rng).tolist() == [0.9, 0.9]
    assert GRID.decode(seen.fresh(np.array([0.0, 0.0]), rng)).tolist() == [2.0, 1.0]


def test_when_every_theta_is_tried_it_says_so():
    seen = tried(*[(a, b) for a in (0.0, 0.5, 1.0) for b in (0.0, 1.0)])
    with pytest.raises(ProtocolError, match="every one of the 6 θ"):
        seen.fresh(np.array([0.0, 0.0]), np.random.default_rng(0))


KNOBS = (
    Knob("gain", 0.01, 10.0, scale="log10"),
    Knob("horizon", 2, 9, integer=True),
    Knob("weight", -5.0, 3.0),
)


def near(knobs):
    """A ball, 6 in 10,000 of the box, in which one horizon is left."""
    away = np.log10(knobs["gain"]) ** 2 + (knobs["horizon"] - 5) ** 2
    return away + (knobs["weight"] - 1) ** 2 - 0.02


LINEAR = KnobSpace(KNOBS, [LinearConstraint("sum", {"gain": 1, "horizon": 1}, 6)])
RING = KnobSpace(KNOBS, [Constraint("ring", lambda k: abs(k["weight"] ** 2 + k["horizon"] - 8) - 1)])
TINY = KnobSpace(KNOBS, [Constraint("near", near, vectorized=True)])
NARROW = KnobSpace(KNOBS, [Constraint("narrow", lambda k: 1e4 * near(k) + 199.9, vectorized=True)])
SPACES = pytest.mark.parametrize("space", [LINEAR, RING, TINY])


@SPACES
def test_drawn_points_are_allowed_differ_and_depend_on_the_generator_alone(space):
    points = Region(space).draw(40, np.random.default_rng(0))
    assert points.shape == (40, 3)
    assert Region(space).allows(points).all()
    assert len(np.unique(points, axis=0)) > 30
    assert np.array_equal(points, Region(space).draw(40, np.random.default_rng(0)))


@pytest.mark.unchecked
def test_a_region_that_no_random_point_hits_is_found_by_its_violation():
    points = Region(NARROW).draw(5, np.random.default_rng(0))
    assert Region(NARROW).allows(points).all()


@pytest.mark.unchecked
@pytest.mark.parametrize("g", [lambda k: k["weight"] ** 2 + 0.5, lambda k: np.nan])
def test_where_nothing_is_allowed_the_error_names_constraint_and_value(g):
    space = KnobSpace(KNOBS, [LINEAR.constraints[0], Constraint("never", g)])
    with pytest.raises(KnobError, match=r"no θ was found.*'never' is (0\.5|nan)"):
        Region(space).draw(1, np.random.default_rng(0))


@SPACES
def test_points_outside_are_moved_to_the_edge_and_points_inside_stay(space):
    rng = np.random.default_rng(0)
    region, anchors = Region(space), space.snap_all(random_points(space, 3, rng))
    z = space.snap_all(np.vstack([rng.random((30, 3)), anchors]))
    moved, allowed = region.repaired(z, anchors), region.allows(z)
    assert region.allows(moved).all()
    assert np.array_equal(moved[allowed], z[allowed])
    assert space.snap_all(moved, only_integers=True) == pytest.approx(moved)


def test_a_moved_point_lies_at_the_edge():
    square = [Knob("a", 0, 1), Knob("b", 0, 1)]
    region = Region(KnobSpace(square, [LinearConstraint("half", {"a": 1}, 0.5)]))
    moved = region.repaired(np.array([[1.0, 1.0]]), np.array([[0.0, 0.0]]))
    assert moved[0] == pytest.approx([0.5, 0.5], abs=1e-3)


@SPACES
def test_the_start_is_allowed_space_filling_and_the_same_each_time(space):
    points = latin_hypercube(space, 12, seed=3)
    assert Region(space).allows(points).all()
    assert len(np.unique(points, axis=0)) == 12
    assert np.array_equal(points, latin_hypercube(space, 12, seed=3))


def test_points_of_the_start_that_are_allowed_stay():
    free, kept = latin_hypercube(KnobSpace(KNOBS), 12, 3), latin_hypercube(LINEAR, 12, 3)
    allowed = Region(LINEAR).allows(free)
    assert 0 < allowed.sum() < 12
    assert np.array_equal(free[allowed], kept[allowed])


def test_capacity_counts_the_theta_that_are_allowed():
    grid = [Knob("a", 0, 4, integer=True), Knob("b", 1, 4, integer=True)]
    assert capacity(KnobSpace(grid, [LinearConstraint("sum", {"a": 1, "b": 1}, 3)])) == 6
    assert 1e5 < capacity(LINEAR) < np.inf  # too many to look at all
    with pytest.raises(KnobError, match=r"\['sum'\] allow none of the 20 θ"):
        capacity(KnobSpace(grid, [LinearConstraint("sum", {"a": 1, "b": 1}, 0)]))


def test_without_constraints_random_points_are_the_generator_s_own():
    drawn = random_points(KnobSpace(KNOBS), 7, np.random.default_rng(5))
    assert np.array_equal(drawn, np.random.default_rng(5).random((7, 3)))


def test_the_search_domain_snaps_to_allowed_points():
    book = History()
    for z in random_points(TINY, 3, np.random.default_rng(0)):
        book = book.with_pending(in_cube(TINY.snap(z))).with_answer(Answer(None), book.incumbent)
    domain = Domain.of(TINY, book)
    snapped = domain.snap(np.random.default_rng(1).random((20, 3)))
    assert Region(TINY).allows(snapped).all()


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


RNG = np.random.default_rng(3)
SCORED = RNG.uniform(-1, 1, (9, 2))
VALUES = RNG.random(9)


def weights(z):
    return Weights.of(squared_distances(np.atleast_2d(z), SCORED))


def test_it_follows_the_published_formulas_one_by_one():
    z = np.array([0.15, -0.4])
    d = np.sum((z - SCORED) ** 2, axis=1)
    w = np.exp(-d) / d
    assert weights(z).distance[0] == pytest.approx(2 / np.pi * np.arctan(1 / w.sum()))
    s2 = np.sum(w / w.sum() * (VALUES - 0.3) ** 2)
    assert weights(z).variance(VALUES, np.array([0.3]))[0] == pytest.approx(s2)


def test_both_are_zero_on_a_sample_where_the_value_is_known():
    at = weights(SCORED)
    assert np.array_equal(at.distance, np.zeros(9))
    assert at.variance(VALUES, VALUES) == pytest.approx(np.zeros(9), abs=1e-12)


@given(z=st.tuples(st.floats(-1, 1), st.floats(-1, 1)), alpha=st.floats(0, 2), delta=st.floats(0, 2))
def test_the_acquisition_has_the_slope_of_its_values(z, alpha, delta):
    z = np.array(z)
    interpolant, _ = interpolate(SCORED, VALUES, 0.7, "inverse_quadratic")
    acquisition = ValueAcquisition(interpolant, VALUES, alpha, delta)
    inside = np.clip((z + 1) / 2, 0.01, 0.99)
    if np.sqrt(squared_distances(2 * inside[None] - 1, SCORED).min()) < 0.02:
        return  # s has a kink on every sample
    value, slope = acquisition.value_and_gradient(inside)
    assert value == pytest.approx(acquisition(inside[None])[0])
    error = check_grad(
        lambda x: acquisition(x[None])[0],
        lambda x: acquisition.value_and_gradient(x)[1],
        inside,
        epsilon=1e-7,
    )
    assert error < 1e-3 * (1 + np.abs(slope).max())


def test_next_to_a_sample_nothing_overflows():
    interpolant, _ = interpolate(SCORED, VALUES, 0.7, "inverse_quadratic")
    acquisition = ValueAcquisition(interpolant, VALUES, 0.8, 0.5)
    with np.errstate(all="raise", under="ignore"):
        for step in (0.0, 1e-200, 1e-12, 1e-6):
            z = (SCORED[:1] + 1) / 2 + step
            assert np.isfinite(acquisition(z)).all()
            assert np.isfinite(acquisition.value_and_gradient(z[0])[1]).all()


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
    assert found[0] == pytest.approx(center, abs=1e-6)


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
