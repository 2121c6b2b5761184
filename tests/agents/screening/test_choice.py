"""Which simulated θ is worth showing."""

import numpy as np
import pytest

from prefcal_agents.screening.choice import clearly_apart, expected_best, trend, worth

COSTS = np.array([[0.1, 0.2, 0.3], [0.9, 0.0, 0.5]])  # ranks 1 2 3 and 3 1 2
LOG4, LOG5, LOG6 = np.log([4.0, 5.0, 6.0])


def test_worth_is_the_logarithm_of_the_rank_plus_3():
    assert worth(COSTS) == pytest.approx(-np.array([[LOG4, LOG5, LOG6], [LOG6, LOG4, LOG5]]))


def test_equal_costs_rank_in_the_order_simulated_and_infinite_ones_last():
    costs = np.array([[0.5, np.inf, 0.5, 0.1]])
    assert np.exp(-worth(costs)[0]) - 3 == pytest.approx([2, 4, 3, 1])


def test_before_anything_is_shown_the_expected_worth_counts():
    expected = [-(LOG4 + LOG6) / 2, -(LOG5 + LOG4) / 2, -(LOG6 + LOG5) / 2]
    assert expected_best(COSTS, None) == pytest.approx(expected)


def test_with_a_best_so_far_the_better_one_of_both_counts():
    # By hand, against the third: it is never better than the others in the first draw, and better
    # than the first in the second draw.
    expected = [-(LOG4 + LOG5) / 2, -(LOG5 + LOG4) / 2, -(LOG6 + LOG5) / 2]
    assert expected_best(COSTS, 2) == pytest.approx(expected)


def test_the_best_so_far_gains_nothing_and_nothing_is_below_it():
    costs = np.random.default_rng(0).random((50, 30))
    for best in (0, 17):
        found = expected_best(costs, best)
        assert found[best] == found.min()
        assert found[best] == pytest.approx(worth(costs)[:, best].mean())


def test_the_trend_points_to_where_worth_grows():
    z = np.random.default_rng(0).random((300, 2))
    costs = np.array([z[:, 0] + 0.01 * z[:, 1], 2 * z[:, 0]])
    slopes = trend(z, costs, int(np.argmin(z[:, 0])))
    assert slopes[0] < 0
    assert abs(slopes[1]) < 0.3 * abs(slopes[0])


def test_a_clear_difference_is_a_share_of_the_value_and_of_what_is_usual():
    kpis = np.array([[1.0, 5.0], [1.05, 5.0], [1.5, 5.0], [np.inf, 5.0], [3.0, 5.0]])
    apart = clearly_apart(kpis, np.array([True, True, True, False, True]), 0)
    assert apart.tolist() == [False, False, True, True, True]
    assert not clearly_apart(kpis, np.ones(5, dtype=bool), 3).any()  # nothing to measure from
