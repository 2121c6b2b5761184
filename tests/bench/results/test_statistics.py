"""Statistics of gaps, against closed forms and by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_bench.results.statistics import FLOOR, difference, holm
from prefcal_env.errors import SettingsError

GAPS = st.floats(0, 1e3)
PAIRS = st.lists(st.tuples(GAPS, GAPS), min_size=1, max_size=8)


def compare(a, b):
    return difference(np.array(a), np.array(b), rng=np.random.default_rng(0))


def test_ten_times_the_gap_on_every_seed_is_a_ratio_of_ten_for_sure():
    base = np.array([1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 3e-2])
    d = compare(10 * base, base)
    assert d.log10_ratio == pytest.approx(1)
    assert (d.low, d.high) == (pytest.approx(1), pytest.approx(1))
    assert (d.wins, d.ties, d.losses, d.pairs) == (0, 0, 6, 6)


def test_wilcoxon_of_six_differences_of_one_sign_has_its_smallest_p():
    ratios = np.array([1.1, 1.2, 1.3, 1.5, 1.9, 2.4])
    assert compare(ratios, np.ones(6)).p == pytest.approx(2 / 2**6)


def test_wilcoxon_by_hand_with_one_rank_against_the_others():
    # Rank 1 against ranks 2 to 5: of 2^5 patterns of signs, 2 have such a small sum, or none.
    d = compare(10.0 ** np.array([-0.1, 0.2, 0.3, 0.4, 0.5]), np.ones(5))
    assert d.p == pytest.approx(2 * 2 / 2**5)


def test_gaps_below_the_floor_are_equal():
    d = compare([0.0, FLOOR / 2, -1e-12], [FLOOR / 9, 0.0, 0.0])
    assert (d.log10_ratio, d.wins, d.ties, d.losses, d.p) == (0, 0, 3, 0, 1.0)


def test_the_floor_is_what_smaller_gaps_count_as():
    assert compare([0.0], [1.0]).log10_ratio == pytest.approx(np.log10(FLOOR))


def test_one_pair_has_no_interval():
    d = compare([1.0], [10.0])
    assert (d.low, d.high, d.log10_ratio) == (None, None, pytest.approx(-1))


def test_the_average_is_the_median():
    assert compare(10.0 ** np.array([0.0, 0.0, 3.0]), np.ones(3)).log10_ratio == 0


def test_the_interval_of_a_median_agrees_with_order_statistics():
    d = np.linspace(-1, 1, 21)  # the 6th and 16th value bound the median with 97.3 %
    found = compare(10.0**d, np.ones(21))
    assert d[4] <= found.low <= d[7]
    assert d[13] <= found.high <= d[16]


def test_the_same_generator_gives_the_same_interval():
    a, b = np.random.default_rng(3).random((2, 12))
    assert compare(a, b) == compare(a, b)


@settings(max_examples=15)
@given(PAIRS)
def test_swapping_agents_flips_the_sign(pairs):
    a, b = np.array(pairs).T
    one, two = compare(a, b), compare(b, a)
    assert one.log10_ratio == pytest.approx(-two.log10_ratio, abs=1e-9)
    assert (one.wins, one.ties, one.losses) == (two.losses, two.ties, two.wins)
    assert one.p == pytest.approx(two.p)
    if one.low is not None:
        assert (one.low, one.high) == (
            pytest.approx(-two.high, abs=1e-9),
            pytest.approx(-two.low, abs=1e-9),
        )
        assert one.low - 1e-9 <= one.log10_ratio <= one.high + 1e-9


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
