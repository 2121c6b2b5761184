import numpy as np
import pytest

from prefcal_bench.people.limited import Limit, Limited
from prefcal_bench.people.weighted import Term, Weighted
from support.people import only, runs

pytestmark = pytest.mark.filterwarnings("error")
REST = Weighted((Term("effort", 1.0, good=0.0, scale=1.0, steepness=1.0),))
RULE = Limited((Limit("error", 2.0, scale=1.0), Limit("noise", 1.0, scale=3.0)), REST)


def test_an_excess_by_hand():
    limit = Limit("error", 2.0, scale=1.0)
    these = runs([0.0], [2.0], [3.0], [5.0], [np.inf], [np.nextafter(2.0, 3.0)])
    assert limit.excess(these) == pytest.approx([0.0, 0.0, 0.5, 0.75, 1.0, 0.0])
    assert limit.excess(these)[-1] > 0  # but just beyond is beyond


def test_within_the_limits_the_trade_off_decides_and_beyond_them_the_excess():
    within, dear, beyond, far = ([2.0, 0.0, 1.0], [0.0, np.inf, 0.0], [3.0, 0.0, 1.0], [3.0, 0.0, 4.0])
    these = runs(within, dear, beyond, far)
    # 0.5 times the trade-off; then 0.5 + 0.5 times the mean excess, of (0.5, 0) and (0.5, 0.5)
    assert RULE.cost(these) == pytest.approx([0.0, 0.5, 0.625, 0.75])
    assert [RULE.compare(only(these, k), only(these, k + 1))[0] for k in range(3)] == [-1] * 3


def test_the_smallest_excess_is_worse_than_the_worst_within_and_better_than_an_interruption():
    just = np.nextafter(2.0, 3.0)
    these = runs([2.0, np.inf, 1.0], [just, 0.0, 0.0], [0.0, 0.0, 0.0], survived=[np.inf, np.inf, 99.0])
    assert RULE.compare(these, only(these, 1)).tolist() == [-1, 0, 1]
    assert RULE.cost(these)[2] > 1.0
