"""Statistics of gaps and of worth, against closed forms, by hand and against chance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_bench.results.statistics import (
    FLOOR,
    difference,
    drift,
    geometric_mean,
    holm,
    improvement,
    interquartile_mean,
    random_search,
)
from prefcal_env.errors import SettingsError

GAPS = st.floats(0, 1e3)
PAIRS = st.lists(st.tuples(GAPS, GAPS), min_size=1, max_size=8)


def compare(a, b):
    return difference(np.array(a), np.array(b), rng=np.random.default_rng(0))


def test_ten_times_the_gap_on_every_seed_is_a_ratio_of_ten_for_sure():
    base = np.array([1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 3e-2])
    d = compare(10 * base, base)
    assert d.log10_ratio == pytest.approx(1)
    assert (d.log10_ratio_low, d.log10_ratio_high) == (pytest.approx(1), pytest.approx(1))
    assert (d.wins, d.ties, d.losses, d.pairs) == (0, 0, 6, 6)


def test_wilcoxon_of_six_differences_of_one_sign_has_its_smallest_p():
    ratios = np.array([1.1, 1.2, 1.3, 1.5, 1.9, 2.4])
    assert compare(ratios, np.ones(6)).p == pytest.approx(2 / 2**6)


def test_gaps_below_the_floor_are_equal():
    d = compare([0.0, FLOOR / 2, -1e-12], [FLOOR / 9, 0.0, 0.0])
    assert (d.log10_ratio, d.wins, d.ties, d.losses, d.p) == (0, 0, 3, 0, 1.0)


def test_the_floor_is_what_smaller_gaps_count_as():
    assert compare([0.0], [1.0]).log10_ratio == pytest.approx(np.log10(FLOOR))


def test_one_pair_has_no_interval():
    d = compare([1.0], [10.0])
    assert (d.log10_ratio_low, d.log10_ratio_high, d.log10_ratio) == (None, None, pytest.approx(-1))


@settings(max_examples=15)
@given(PAIRS)
def test_swapping_agents_flips_the_sign(pairs):
    a, b = np.array(pairs).T
    one, two = compare(a, b), compare(b, a)
    assert one.log10_ratio == pytest.approx(-two.log10_ratio, abs=1e-9)
    assert (one.wins, one.ties, one.losses) == (two.losses, two.ties, two.wins)
    assert one.p == pytest.approx(two.p)
    if one.log10_ratio_low is not None:
        assert (one.log10_ratio_low, one.log10_ratio_high) == (
            pytest.approx(-two.log10_ratio_high, abs=1e-9),
            pytest.approx(-two.log10_ratio_low, abs=1e-9),
        )
        assert one.log10_ratio_low - 1e-9 <= one.log10_ratio <= one.log10_ratio_high + 1e-9


@pytest.mark.parametrize(("a", "b"), [([], []), ([1.0], [1.0, 2.0])])
def test_what_does_not_pair_is_refused(a, b):
    with pytest.raises(SettingsError, match="pairs"):
        compare(a, b)


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8), st.randoms())
def test_holm_never_lowers_a_p_and_does_not_depend_on_the_order(p, random):
    corrected = holm(p)
    assert all(q >= v - 1e-12 for q, v in zip(corrected, p, strict=True))
    assert max(corrected) <= 1
    order = list(range(len(p)))
    random.shuffle(order)
    assert holm([p[i] for i in order]) == [corrected[i] for i in order]


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
