"""Which simulated θ is worth showing."""

import numpy as np
import pytest

from prefcal_agents.people import expected_best, worth
from prefcal_agents.screening.agent import clearly_apart, now_and_next
from prefcal_agents.screening.findings import trend

COSTS = np.array([[1.0, 3.0, 5.0], [9.0, 0.0, 5.0]])  # places 1 2 3 and 3 1 2, all noticed
LOG4, LOG5, LOG6 = np.log([4.0, 5.0, 6.0])


def test_worth_is_the_logarithm_of_the_number_of_noticeably_better_ones_plus_4():
    assert worth(COSTS) == pytest.approx(-np.array([[LOG4, LOG5, LOG6], [LOG6, LOG4, LOG5]]))
    alike = np.array([[1.0, 1.5, 2.4, np.inf]])  # the third differs noticeably from the first only
    assert np.exp(-worth(alike)[0]) - 4 == pytest.approx([0, 0, 1, 3])


def test_before_anything_is_shown_the_expected_worth_counts():
    expected = [-(LOG4 + LOG6) / 2, -(LOG5 + LOG4) / 2, -(LOG6 + LOG5) / 2]
    assert expected_best(COSTS, None) == pytest.approx(expected)


def test_with_a_best_so_far_the_better_one_of_both_counts():
    # By hand, against the third: it is never better than the others in the first draw, and better
    # than the first in the second draw.
    expected = [-(LOG4 + LOG5) / 2, -(LOG5 + LOG4) / 2, -(LOG6 + LOG5) / 2]
    assert expected_best(COSTS, 2) == pytest.approx(expected)


def every(costs):
    return np.ones(costs.shape[1], dtype=bool)


def test_by_hand_what_is_expected_now_and_after_the_next_answer():
    costs = np.array([[5.0, 3.0, 0.0], [5.0, 0.0, 9.0]])  # the first one is the best so far
    # Against the second: both prefer it, and then the third one is better in the first draw alone.
    now, then = -(LOG5 + LOG4) / 2, -LOG4
    assert now_and_next(costs, worth(costs), 0, every(costs))[1] == pytest.approx((now + then) / 2)
    # Only the second one may be shown, now and later: the first draw keeps it, in second place.
    only = np.array([False, True, False])
    found = now_and_next(costs, worth(costs), 0, only)
    assert found[1] == pytest.approx(now)
    assert np.isneginf(found[[0, 2]]).all()


def test_a_question_that_tells_two_kinds_of_people_apart_is_worth_more_than_its_winner():
    # The best so far, what a half of the people wants, what the other half wants, something that
    # is a little better for all, and something a little better for the first half alone.
    costs = np.array([[50.0, 0.0, 90.0, 40.0, 40.0], [50.0, 90.0, 0.0, 40.0, 90.0]])
    costs = np.hstack([np.repeat(costs, 20, axis=0), np.full((40, 60), 99.0)])
    once, twice = expected_best(costs, 0), now_and_next(costs, worth(costs), 0, every(costs))
    assert np.argmax(twice) in (1, 2)
    for_all, telling = 2 * twice[[3, 4]] - once[[3, 4]]  # after the next answer
    assert once[4] < once[3]
    assert telling > for_all


def test_no_likely_tie_is_asked_while_something_else_promises_enough():
    draws = np.arange(10)
    likely = np.where(draws < 4, 0.0, 10.0)  # the very best for four of ten, alike for the others
    better = np.where(draws < 4, 0.2, 30.0)  # as good for those, and poor for the others
    worse = np.full(10, 20.0)
    costs = np.column_stack([np.full(10, 10.0), likely, worse, np.full((10, 3), 0.5)])
    allowed = np.array([True, True, True, False, False, False])
    assert np.isfinite(now_and_next(costs, worth(costs), 0, allowed)[1])  # the other one promises nothing
    costs[:, 2] = better
    assert np.isneginf(now_and_next(costs, worth(costs), 0, allowed)[1])


def test_the_trend_points_to_where_worth_grows():
    z = np.random.default_rng(0).random((300, 2))
    costs = np.array([z[:, 0] + 0.01 * z[:, 1], 2 * z[:, 0]])
    slopes = trend(z, worth(costs).mean(axis=0), int(np.argmin(z[:, 0])))
    assert slopes[0] < 0
    assert abs(slopes[1]) < 0.3 * abs(slopes[0])


def test_a_clear_difference_is_a_share_of_the_value_and_of_what_is_usual():
    kpis = np.array([[1.0, 5.0], [1.05, 5.0], [1.5, 5.0], [np.inf, 5.0], [3.0, 5.0]])
    apart = clearly_apart(kpis, np.array([True, True, True, False, True]), 0)
    assert apart.tolist() == [False, False, True, True, True]
    assert not clearly_apart(kpis, np.ones(5, dtype=bool), 3).any()  # nothing to measure from
