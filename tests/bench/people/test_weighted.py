import numpy as np
import pytest

from prefcal_bench.people.weighted import Term, Weighted
from support.people import runs

pytestmark = pytest.mark.filterwarnings("error")


def test_a_term_by_hand():
    term = Term("error", 0.6, good=1.0, scale=2.0, steepness=2.0)
    # weight / (1 + (2 / distance)²) at distances 0, 1, 2, 4 and infinity
    costs = term.cost(runs([1.0], [2.0], [3.0], [5.0], [np.inf]))
    assert costs == pytest.approx([0.0, 0.6 / 5, 0.6 / 2, 0.6 / 1.25, 0.6])


def test_what_is_better_than_good_costs_nothing():
    assert Term("error", 1.0, good=1.0, scale=2.0, steepness=1.0).cost(runs([0.5]))[0] == 0


def test_next_to_zero_and_infinity_there_is_no_warning():
    tiny, huge = np.nextafter(0, 1), np.finfo(float).max
    term = Term("error", 1.0, good=0.0, scale=1.0, steepness=2.0)
    assert term.cost(runs([tiny], [1e-200], [huge])).tolist() == [0.0, 0.0, 1.0]


def test_returns_diminish_near_good_with_a_steep_term():
    cost = Term("error", 1.0, good=0.0, scale=1.0, steepness=2.0).cost(runs([0.1], [0.2], [0.9]))
    assert cost[1] - cost[0] < 0.03
    assert cost[2] > 0.4


def test_a_trade_off_adds_terms_and_puts_interrupted_runs_last():
    terms = (Term("error", 0.5, 0.0, 1.0, 1.0), Term("effort", 0.5, 0.0, 4.0, 1.0))
    rule = Weighted(terms)
    these = runs([1.0, 4.0], [3.0, 0.0], [0.0, 0.0], survived=[np.inf, np.inf, 3.0])
    assert rule.trade_off(these) == pytest.approx([0.5, 0.375, 0.0])
    assert rule.cost(these) == pytest.approx([0.5, 0.375, 1.25])
    assert rule.compare(these, these.take(np.array([0]))).tolist() == [0, -1, 1]
