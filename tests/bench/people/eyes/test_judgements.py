"""What each kind of person with eyes says about runs, by hand."""

import numpy as np
import pytest

from prefcal_bench.people.eyes.ideal import Ideal, Wish
from prefcal_bench.people.eyes.majority import Majority
from prefcal_bench.people.eyes.noticing import Eyes, noticeable
from prefcal_bench.people.eyes.order import Criterion, Order
from prefcal_bench.people.eyes.ranks import Ranks, Scale
from prefcal_bench.people.eyes.trade import Share, Trade
from support.people import runs


def verdict(by, one, other, **more):
    return int(Eyes(by).compare(runs(one, **more), runs(other))[0])


def test_a_difference_is_noticed_from_just_above_the_threshold_on():
    assert noticeable(np.array([-1.1, -1.0, 0.0, 1.0, 1.1, np.inf]), 1.0).tolist() == [-1, 0, 0, 0, 1, 1]


def test_the_first_criterion_that_differs_noticeably_decides_and_else_it_is_a_tie():
    order = Order((Criterion("error", 0.5), Criterion("effort", 1.0)))
    assert verdict(order, [1.0, 9.0], [1.6, 0.0]) == -1
    assert verdict(order, [1.0, 9.0], [1.4, 0.0]) == 1
    assert verdict(order, [1.0, 1.0], [1.4, 1.9]) == 0  # to the end


def test_below_its_limit_a_criterion_finds_all_alike():
    order = Order((Criterion("error", 0.1, at_most=2.0), Criterion("effort", 0.1)))
    assert verdict(order, [0.0, 5.0], [2.0, 4.0]) == 1
    assert verdict(order, [0.0, 5.0], [2.2, 4.0]) == -1


def test_what_could_not_be_measured_is_noticeably_worse_and_alike_among_itself():
    order = Order((Criterion("error", 1.0), Criterion("effort", 1.0)))
    assert verdict(order, [np.inf, 0.0], [1e9, 9.0]) == 1
    assert verdict(order, [np.inf, 0.0], [np.inf, 9.0]) == -1


def test_the_majority_of_noticeable_differences_wins_and_even_votes_are_a_tie():
    votes = Majority((Criterion("error", 0.5), Criterion("effort", 0.5), Criterion("noise", 0.5)))
    assert verdict(votes, [0.0, 0.0, 9.0], [1.0, 1.0, 0.0]) == -1
    assert verdict(votes, [0.0, 9.0, 9.0], [1.0, 1.0, 0.0]) == 1
    assert verdict(votes, [0.0, 9.0, 0.0], [1.0, 1.0, 0.4]) == 0


@pytest.mark.parametrize(("power", "distance"), [(1.0, 7.0), (2.0, 5.0), (np.inf, 4.0)])
def test_the_distance_from_the_ideal_run_by_hand(power, distance):
    ideal = Ideal((Wish("error", 1.0, 2.0), Wish("effort", 0.0, 1.0)), power, 0.5)
    assert ideal.total(runs([7.0, 4.0]))[0] == pytest.approx(distance)  # 3 and 4 scales
    assert ideal.total(runs([0.0, 0.0]))[0] == 0  # better than ideal is as good
    assert verdict(ideal, [7.0, 4.0], [7.0, 4.4]) == 0
    assert verdict(ideal, [7.0, 4.0], [7.0, 6.0]) == -1


def test_nothing_is_farther_than_ten_scales():
    ideal = Ideal((Wish("error", 0.0, 1.0), Wish("effort", 0.0, 1.0)), 1.0, 0.5)
    assert ideal.total(runs([np.inf, 1.0], [40.0, 1.0])).tolist() == [11.0, 11.0]


def test_ranks_add_up_and_lie_between_the_marks():
    ranks = Ranks((Scale("error", (1.0, 3.0), (0.2, 0.6)), Scale("effort", (5.0,), (0.5,))), 0.15)
    assert ranks.total(runs([2.0, 5.0], [0.0, 9.0], [np.inf, 0.0])) == pytest.approx(
        [0.4 + 0.5, 0.2 + 1.0, 1.0 + 0.5]
    )
    assert verdict(ranks, [2.0, 5.0], [2.5, 5.0]) == 0
    assert verdict(ranks, [2.0, 5.0], [3.0, 5.0]) == -1


def test_a_trade_off_by_hand_and_its_returns_diminish():
    trade = Trade((Share("error", 0.6, 1.0, 2.0, 2.0), Share("effort", 0.4, 0.0, 1.0, 1.0)), 0.2)
    assert trade.total(runs([3.0, 1.0]))[0] == pytest.approx(np.log(2.0))
    near, far = trade.total(runs([1.2, 0.0], [1.4, 0.0], [3.2, 0.0], [3.4, 0.0])).reshape(2, 2)
    assert np.diff(near) < np.diff(far) / 3
    assert verdict(trade, [3.0, 1.0], [3.3, 1.0]) == 0
    assert verdict(trade, [3.0, 1.0], [3.0, 3.0]) == -1
    assert trade.total(runs([np.inf, 0.0]))[0] == pytest.approx(0.6 * np.log1p(1e4))
