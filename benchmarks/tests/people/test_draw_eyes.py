"""People with eyes on closed loops: how much they find alike, and what they judge by."""

from functools import cache

import numpy as np
import pytest

from bench_support.people import EYES, NAMES, runs
from prefcal_bench.people import USUAL, draw, named
from prefcal_bench.people.judgements import Order, Total
from prefcal_bench.people.looks import LOOKS
from prefcal_bench.people.sample import sample
from prefcal_scenarios.catalog import load

pytestmark = [pytest.mark.slow, pytest.mark.unchecked]  # for speed: the judgements are checked
LOOPS = ("servo", "building", "rough-3")
SEEDS = range(3)


@cache
def sampled(loop, name, count):
    """The first runs of a sample, which is kept in a file that all workers read."""
    return sample(load(loop), name).take(np.arange(count))


@cache
def person(loop, kind, seed):
    return named._usable(kind, sampled(loop, USUAL, 512), seed)


def leaders(rule, pool, count=100):
    """The best runs of a pool: those that the fewest of the likely ones beat."""
    opponents = [pool.take(np.array([k])) for k in range(0, len(pool), 160)]
    wins = np.sum([rule.compare(pool, one) < 0 for one in opponents], axis=0)
    likely = np.argsort(-wins, kind="stable")[: 4 * count]
    among = pool.take(likely)
    beaten = [np.sum(rule.compare(among, pool.take(np.array([k]))) < 0) for k in likely]
    return pool.take(likely[np.argsort(beaten, kind="stable")[:count]])


def ties(rule, pool):
    best = leaders(rule, pool)
    first, second = np.triu_indices(len(best), 1)
    return draw.alike(rule, best.take(first), best.take(second))


@pytest.mark.parametrize("kind", EYES)
def test_a_tenth_to_two_fifths_of_the_pairs_among_the_best_hundred_of_a_pool_are_ties(kind):
    found = np.array(
        [ties(person(loop, kind, seed), sampled(loop, "pool", 8192)) for loop in LOOPS for seed in SEEDS]
    )
    assert 0.1 <= np.median(found) <= 0.4
    assert np.mean((found >= 0.1) & (found <= 0.4)) > 0.5
    assert found.max() < 0.8


def test_an_order_has_limits_half_of_the_time_and_none_on_its_last_criterion():
    limited = []
    for seed in range(12):
        by = draw.order(sampled("servo", USUAL, 512), np.random.default_rng(seed)).by
        assert 2 <= len(by.criteria) <= 6
        assert by.criteria[-1].at_most == -np.inf
        assert all(criterion.noticed > 0 for criterion in by.criteria)
        limited += [np.isfinite(criterion.at_most) for criterion in by.criteria[:-1]]
    assert 0.25 < np.mean(limited) < 0.75


def test_who_looks_at_the_curves_judges_by_nothing_that_is_a_kpi():
    kinds = set()
    for seed in range(8):
        by = draw.curves(sampled("servo", USUAL, 512), np.random.default_rng(seed)).by
        kinds.add(type(by))
        names = [one.name for one in (by.criteria if isinstance(by, Order) else by.parts)]
        assert 2 <= len(names) <= 4
        assert set(names) <= set(LOOKS)
    assert kinds == {Order, Total}


def test_without_curves_the_kpis_are_what_is_seen():
    by = draw.curves(runs([1.0, 2.0], [2.0, 1.0], [3.0, 3.0]), np.random.default_rng(0)).by
    assert set(NAMES) >= {one.name for one in getattr(by, "criteria", ()) or by.parts}


def test_majorities_are_of_three_or_five_and_no_one_has_two_votes():
    sizes = set()
    for seed in range(10):
        by = draw.majority(sampled("servo", USUAL, 512), np.random.default_rng(seed)).by
        names = [criterion.name for criterion in by.criteria]
        assert len(set(names)) == len(names)
        sizes.add(len(names))
    assert sizes == {3, 5}
