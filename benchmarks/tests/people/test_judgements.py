"""What each kind of person with just noticeable differences says about runs, by hand."""

import numpy as np
import pytest

from bench_support.people import only, runs
from prefcal_bench.people.judgements import Loss, Majority, Noticed, Order, Rank, Total, Wish
from prefcal_bench.people.rule import Noticing, noticeable

pytestmark = pytest.mark.filterwarnings("error")


def verdict(by, one, other, **more):
    return int(Noticing(by).compare(runs(one, **more), runs(other))[0])


def test_a_difference_is_noticed_from_just_above_the_threshold_on():
    assert noticeable(np.array([-1.1, -1.0, 0.0, 1.0, 1.1, np.inf]), 1.0).tolist() == [-1, 0, 0, 0, 1, 1]


def test_the_first_criterion_that_differs_noticeably_decides_and_else_it_is_a_tie():
    order = Order((Noticed("error", 0.5), Noticed("effort", 1.0)))
    assert verdict(order, [1.0, 9.0], [1.6, 0.0]) == -1
    assert verdict(order, [1.0, 9.0], [1.4, 0.0]) == 1
    assert verdict(order, [1.0, 1.0], [1.4, 1.9]) == 0  # to the end
    assert Noticing(order).cost(runs([1.0, 1.0])) is None


def test_below_its_limit_a_criterion_finds_all_alike():
    order = Order((Noticed("error", 0.1, at_most=2.0), Noticed("effort", 0.1)))
    assert verdict(order, [0.0, 5.0], [2.0, 4.0]) == 1
    assert verdict(order, [0.0, 5.0], [2.2, 4.0]) == -1


def test_what_could_not_be_measured_is_noticeably_worse_and_alike_among_itself():
    order = Order((Noticed("error", 1.0), Noticed("effort", 1.0)))
    assert verdict(order, [np.inf, 0.0], [1e9, 9.0]) == 1
    assert verdict(order, [np.inf, 0.0], [np.inf, 9.0]) == -1


def test_the_majority_of_noticeable_differences_wins_and_even_votes_are_a_tie():
    votes = Majority((Noticed("error", 0.5), Noticed("effort", 0.5), Noticed("noise", 0.5)))
    assert verdict(votes, [0.0, 0.0, 9.0], [1.0, 1.0, 0.0]) == -1
    assert verdict(votes, [0.0, 9.0, 9.0], [1.0, 1.0, 0.0]) == 1
    assert verdict(votes, [0.0, 9.0, 0.0], [1.0, 1.0, 0.4]) == 0


@pytest.mark.parametrize(("power", "distance"), [(1.0, 7.0), (2.0, 5.0), (np.inf, 4.0)])
def test_the_distance_from_the_ideal_run_by_hand(power, distance):
    ideal = Total((Wish("error", 1.0, 2.0), Wish("effort", 0.0, 1.0)), 0.5, power)
    assert ideal.total(runs([7.0, 4.0]))[0] == pytest.approx(distance)  # 3 and 4 scales
    assert ideal.total(runs([0.0, 0.0]))[0] == 0  # better than ideal is as good
    assert verdict(ideal, [7.0, 4.0], [7.0, 4.4]) == 0
    assert verdict(ideal, [7.0, 4.0], [7.0, 6.0]) == -1


def test_nothing_is_farther_than_ten_scales():
    ideal = Total((Wish("error", 0.0, 1.0), Wish("effort", 0.0, 1.0)), 0.5)
    assert ideal.total(runs([np.inf, 1.0], [40.0, 1.0])).tolist() == [11.0, 11.0]


def test_ranks_add_up_and_lie_between_the_marks():
    ranks = Total((Rank("error", (1.0, 3.0), (0.2, 0.6)), Rank("effort", (5.0,), (0.5,))), 0.15)
    assert ranks.total(runs([2.0, 5.0], [0.0, 9.0], [np.inf, 0.0])) == pytest.approx(
        [0.4 + 0.5, 0.2 + 1.0, 1.0 + 0.5]
    )
    assert verdict(ranks, [2.0, 5.0], [2.5, 5.0]) == 0
    assert verdict(ranks, [2.0, 5.0], [3.0, 5.0]) == -1


def test_a_trade_off_by_hand_and_its_returns_diminish():
    trade = Total((Loss("error", 0.6, 1.0, 2.0, 2.0), Loss("effort", 0.4, 0.0, 1.0, 1.0)), 0.2)
    assert trade.total(runs([3.0, 1.0]))[0] == pytest.approx(np.log(2.0))
    near, far = trade.total(runs([1.2, 0.0], [1.4, 0.0], [3.2, 0.0], [3.4, 0.0])).reshape(2, 2)
    assert np.diff(near) < np.diff(far) / 3
    assert verdict(trade, [3.0, 1.0], [3.3, 1.0]) == 0
    assert verdict(trade, [3.0, 1.0], [3.0, 3.0]) == -1
    assert trade.total(runs([np.inf, 0.0]))[0] == pytest.approx(0.6 * np.log1p(1e4))


@pytest.mark.parametrize(
    ("x", "y", "verdict"),
    [
        (1.0, 1.5, 0),  # 0.5 is not noticed, just more is
        (1.0, 1.5000001, -1),
        (3.0, 2.0, 1),
        (np.inf, 2.0, 1),
        (np.inf, np.inf, 0),
        (0.0, 0.0, 0),
    ],
)
def test_an_absolute_difference_by_hand(x, y, verdict):
    assert Noticed("error", 0.5).verdict(runs([x]), runs([y]))[0] == verdict


@pytest.mark.parametrize(
    ("x", "y", "verdict"),
    [
        (8.0, 10.0, 0),  # 20 % of the larger value
        (7.9, 10.0, -1),
        (0.8, 1.0, 0),
        (1.0, 0.7, 1),
        (-10.0, -7.9, -1),  # as for a KPI of which more is better
        (-10.0, -8.0, 0),
        (0.0, 0.0, 0),
        (0.0, 1e-300, -1),  # anything is more than nothing
        (np.inf, 1.0, 1),
        (np.inf, np.inf, 0),
    ],
)
def test_a_relative_difference_by_hand(x, y, verdict):
    priority = Noticed("error", 0.2, relative=True)
    assert priority.verdict(runs([x]), runs([y]))[0] == verdict
    assert priority.verdict(runs([y]), runs([x]))[0] == -verdict


def test_priorities_go_round_in_circles():
    rule = Noticing(Order((Noticed("error", 1.0), Noticed("effort", 0.0))))
    these = runs([0.0, 2.0], [0.8, 1.0], [1.6, 0.0])
    # Steps of 0.8 in the error are not noticed, but 1.6 is: each beats the one before, but the
    # first beats the last.
    assert [rule.compare(only(these, b), only(these, a))[0] for a, b in ((0, 1), (1, 2))] == [-1] * 2
    assert rule.compare(only(these, 0), only(these, 2))[0] == -1
