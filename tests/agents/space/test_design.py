import numpy as np
import pytest
from scipy.stats import qmc

from prefcal_agents.search import Tried, capacity, latin_hypercube
from prefcal_env.errors import ProtocolError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History, Sample

SPACE = KnobSpace(
    [
        Knob("real", 2.0, 5.0, step=0),
        Knob("count", 3, 17, integer=True),
        Knob("decades", 1, 5000, scale="log10", integer=True),
    ]
)
GRID = KnobSpace([Knob("a", 0, 2, integer=True), Knob("b", 0, 1, integer=True)])


def test_a_latin_hypercube_has_one_sample_in_every_stratum_of_every_knob():
    points = latin_hypercube(SPACE, 10, seed=3)
    for column in points.T:
        assert sorted(np.floor(10 * column)) == list(range(10))


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
