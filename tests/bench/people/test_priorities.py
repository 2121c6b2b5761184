import numpy as np
import pytest

from prefcal_bench.people.priorities import Priorities, Priority
from support.people import only, runs

pytestmark = pytest.mark.filterwarnings("error")


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
    assert Priority("error", 0.5).compare(runs([x]), runs([y]))[0] == verdict


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
    priority = Priority("error", 0.2, relative=True)
    assert priority.compare(runs([x]), runs([y]))[0] == verdict
    assert priority.compare(runs([y]), runs([x]))[0] == -verdict


def test_the_first_noticeable_difference_decides():
    rule = Priorities((Priority("error", 1.0), Priority("effort", 0.0)))
    one, other = runs([1.0, 5.0], [1.0, 5.0], [1.0, 5.0]), runs([3.0, 0.0], [1.9, 0.0], [1.9, 5.0])
    assert rule.compare(one, other).tolist() == [-1, 1, 0]


def test_priorities_go_round_in_circles():
    rule = Priorities((Priority("error", 1.0), Priority("effort", 0.0)))
    these = runs([0.0, 2.0], [0.8, 1.0], [1.6, 0.0])
    # Steps of 0.8 in the error are not noticed, but 1.6 is: each beats the one before, but the
    # first beats the last.
    assert [rule.compare(only(these, b), only(these, a))[0] for a, b in ((0, 1), (1, 2))] == [-1] * 2
    assert rule.compare(only(these, 0), only(these, 2))[0] == -1


def test_there_is_no_cost_with_such_an_order():
    assert Priorities((Priority("error", 1.0),)).cost(runs([1.0])) is None
