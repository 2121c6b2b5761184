"""Statistics of worth, by hand and against chance."""

import numpy as np
import pytest

from prefcal_bench.results.statistics import (
    drift,
    geometric_mean,
    improvement,
    interquartile_mean,
    random_search,
)
from prefcal_env.errors import SettingsError


def rng():
    return np.random.default_rng(0)


def loops(*groups):
    return [np.array(group, dtype=float) for group in groups]


def test_every_loop_counts_the_same_whatever_its_number_of_seeds():
    assert geometric_mean(loops([1, 4], [16] * 5), rng=rng()).value == pytest.approx(32**0.5)


def test_differences_between_loops_do_not_widen_the_interval():
    found = geometric_mean(loops([2, 2, 2], [800, 800]), rng=rng())
    assert found.low == pytest.approx(found.value) == pytest.approx(found.high)


def test_the_interval_covers_the_truth_about_as_often_as_it_says():
    hits = 0
    for seed in range(200):
        drawn = np.random.default_rng(seed)
        groups = [np.exp(drawn.normal(3, 1, size=20)) for _ in range(3)]
        found = geometric_mean(groups, rng=drawn)
        hits += found.low < np.exp(3) < found.high
    assert 180 <= hits <= 198


def test_a_single_seed_has_no_interval():
    found = geometric_mean(loops([4]), rng=rng())
    assert (found.value, found.low, found.high) == (pytest.approx(4), None, None)


def test_the_interquartile_mean_ignores_the_outer_quarters():
    assert interquartile_mean(loops([1, 10], [1000, 1e4], [1, 10], [1000, 9e9])) == pytest.approx(
        (10 * 1000 * 10 * 1000) ** 0.25
    )


def test_improvement_counts_pairs_of_seeds_and_half_of_the_ties():
    found = improvement(loops([1, 3], [5]), loops([2, 3], [1, 1, 1]), rng=rng())
    assert found.value == pytest.approx((1.5 / 4 + 1) / 2)
    assert 0 <= found.low <= found.value <= found.high <= 1


def test_improvement_over_oneself_is_even_and_turns_round():
    groups = loops([1, 2, 3], [7, 7, 9])
    assert improvement(groups, groups, rng=rng()).value == pytest.approx(0.5)
    others = loops([2, 5, 8], [1, 7, 8])
    both = [improvement(*pair, rng=rng()).value for pair in ((groups, others), (others, groups))]
    assert sum(both) == pytest.approx(1)


def test_drift_is_how_much_better_the_best_held_before_was():
    assert drift(loops([1, 8, 2], [1, 1, 5])) == pytest.approx(2)
    assert drift(loops([1, 2, 3])) == 1


def test_random_search_is_worth_what_the_harmonic_numbers_say():
    assert random_search(1) == pytest.approx(np.e)
    assert random_search(50) == pytest.approx(90.0, abs=0.1)
    ranks = np.random.default_rng(0).random((20000, 50)).min(axis=1)
    assert np.exp(np.mean(-np.log(ranks))) == pytest.approx(random_search(50), rel=0.03)


@pytest.mark.parametrize("groups", [[], loops([1], [])])
def test_nothing_has_no_mean(groups):
    with pytest.raises(SettingsError, match="one loop or more"):
        geometric_mean(groups, rng=rng())
    with pytest.raises(SettingsError, match="same loops"):
        improvement(groups, loops([1]) * 3, rng=rng())
