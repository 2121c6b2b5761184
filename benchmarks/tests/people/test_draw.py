from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_support.people import NAMES, kinds, runs
from prefcal_bench.people import Runs
from prefcal_bench.people.draw import KINDS, decided, limits, narrow, priorities, weights
from prefcal_bench.people.draw import rising as rising_one
from prefcal_bench.people.sample import _run, thetas
from prefcal_scenarios.catalog import load

SEEDS = range(25)
pytestmark = pytest.mark.filterwarnings("error")
every = pytest.mark.parametrize("kind", kinds(KINDS))


@cache
def usual(loop="servo"):
    scenario = load(loop)
    return _run(scenario, thetas(scenario, "usual", 256))


def drawn(kind, these=None):
    these = usual() if these is None else these
    return [kind(these, np.random.default_rng(seed)) for seed in SEEDS]


@every
def test_a_rule_follows_from_the_generator(kind):
    rules = drawn(KINDS[kind])
    assert rules == drawn(KINDS[kind])
    assert any(rule != rules[0] for rule in rules)


def test_a_trade_off_is_between_three_kpis_or_more_and_a_narrow_one_between_one_or_two():
    for kind, low, high in ((weights, 3, 6), (narrow, 1, 2)):
        sizes = set()
        for rule in drawn(kind):
            names = [term.name for term in rule.terms]
            assert len(set(names)) == len(names)
            assert set(names) <= set(usual().names)
            assert sum(term.weight for term in rule.terms) == pytest.approx(1.0)
            assert all(t.weight > 0 and t.scale > 0 and 0.5 <= t.steepness <= 2 for t in rule.terms)
            sizes.add(len(names))
        assert (min(sizes), max(sizes)) == (low, high)


@pytest.mark.parametrize("loop", ["servo", "building", "tank"])
def test_the_first_priority_decides_some_random_pairs_and_the_last_notices_everything(loop):
    these, rng = usual(loop), np.random.default_rng(0)
    pairs = rng.integers(len(these), size=(2, 4000))
    relative = set()
    for rule in drawn(priorities, these):
        order = [priority.name for priority in rule.by.criteria]
        assert 3 <= len(order) == len(set(order))
        share = decided(rule.by.criteria[0], these.take(pairs[0]), these.take(pairs[1]))
        assert 0.05 <= share <= 0.6  # 8 to 55 % of the pairs that it was chosen by
        assert (rule.by.criteria[-1].noticed, rule.by.criteria[-1].relative) == (0.0, False)
        relative |= {priority.relative for priority in rule.by.criteria[:-1]}
    assert relative == {True, False}


def test_limits_can_mostly_be_met_and_leave_something_to_wish():
    met = []
    for rule in drawn(limits):
        assert 2 <= len(rule.limits) <= 3
        assert len(rule.terms) == len(usual().names)
        excess = np.sum([limit.cost(usual()) for limit in rule.limits], axis=0)
        met.append(np.mean((excess == 0) & np.isinf(usual().survived)))
    assert np.mean(np.array(met) > 0) > 0.75
    assert max(met) < 1


def test_standards_rise_in_every_term_and_nothing_else_changes():
    for rule in drawn(rising_one):
        for first, final in zip(rule.first.terms, rule.final.terms, strict=True):
            assert first.scale >= final.scale > 0
            assert (first.name, first.weight, first.good, first.steepness) == (
                final.name,
                final.weight,
                final.good,
                final.steepness,
            )


def test_what_is_good_is_nothing_or_the_lowest_value_of_a_kpi_that_can_be_negative():
    these = Runs(
        ("error", "margin"),
        np.array([[1.0, -3.0], [2.0, -5.0], [3.0, -9.0]]),
        np.array([np.inf, np.inf, 1.0]),  # the last run was interrupted, so -9 does not count
    )
    good = {t.name: t.good for rule in drawn(weights, these) for t in rule.terms}
    assert good == {"error": 0.0, "margin": -5.0}


VALUES = st.floats(0.0, 1e9) | st.sampled_from([0.0, 1.0, np.inf])


@every
@given(
    rows=st.lists(st.tuples(VALUES, VALUES, VALUES), min_size=1, max_size=8),
    survived=st.lists(st.sampled_from([np.inf, np.inf, 0.0, 2.0]), min_size=8, max_size=8),
    columns=st.integers(1, 3),
    seed=st.integers(0, 99),
)
def test_there_is_a_rule_for_any_runs(kind, rows, survived, columns, seed):
    these = runs(*[row[:columns] for row in rows], survived=survived[: len(rows)])
    rule = KINDS[kind](these, np.random.default_rng(seed))
    verdicts = rule.compare(these, these.take(np.arange(len(these))[::-1]))
    assert np.array_equal(verdicts, -verdicts[::-1])
    cost = rule.cost(these)
    assert cost is None or np.isfinite(cost).all()


def test_a_single_kpi_is_the_only_priority_and_every_difference_counts():
    (first, *more) = priorities(runs([1.0], [1.1]), np.random.default_rng(0)).by.criteria
    assert not more
    assert (first.name, first.noticed) == (NAMES[0], 0.0)
