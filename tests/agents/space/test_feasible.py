import numpy as np
import pytest

from prefcal_agents.search import Domain, Region, Tried, capacity, latin_hypercube, random_points
from prefcal_env import Constraint, Knob, KnobSpace, LinearConstraint
from prefcal_env.errors import KnobError
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube

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


def test_a_fresh_point_is_allowed():
    seen = Tried(TINY, History())
    z = seen.fresh(np.zeros(3), np.random.default_rng(0))
    assert TINY.allows(TINY.decode(TINY.snap(z)))


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
