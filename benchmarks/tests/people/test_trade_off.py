import numpy as np
import pytest
from hypothesis import given

from bench_support.people import RULES, any_runs, only, runs
from prefcal_bench.people.trade_off import Standards, Term, TradeOff

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
    rule = TradeOff(terms)
    these = runs([1.0, 4.0], [3.0, 0.0], [0.0, 0.0], survived=[np.inf, np.inf, 3.0])
    assert rule.trade_off(these) == pytest.approx([0.5, 0.375, 0.0])
    assert rule.cost(these) == pytest.approx([0.5, 0.375, 1.25])
    assert rule.compare(these, these.take(np.array([0]))).tolist() == [0, -1, 1]


LIMITED = TradeOff(
    (Term("effort", 1.0, good=0.0, scale=1.0),), (Term("error", 1.0, 2.0, 1.0), Term("noise", 1.0, 1.0, 3.0))
)


def test_an_excess_by_hand():
    limit = Term("error", 1.0, 2.0, 1.0)
    these = runs([0.0], [2.0], [3.0], [5.0], [np.inf], [np.nextafter(2.0, 3.0)])
    assert limit.cost(these) == pytest.approx([0.0, 0.0, 0.5, 0.75, 1.0, 0.0])
    assert limit.cost(these)[-1] > 0  # but just beyond is beyond


def test_within_the_limits_the_trade_off_decides_and_beyond_them_the_excess():
    within, dear, beyond, far = ([2.0, 0.0, 1.0], [0.0, np.inf, 0.0], [3.0, 0.0, 1.0], [3.0, 0.0, 4.0])
    these = runs(within, dear, beyond, far)
    # 0.5 times the trade-off; then 0.5 + 0.5 times the mean excess, of (0.5, 0) and (0.5, 0.5)
    assert LIMITED.cost(these) == pytest.approx([0.0, 0.5, 0.625, 0.75])
    assert [LIMITED.compare(only(these, k), only(these, k + 1))[0] for k in range(3)] == [-1] * 3


def test_the_smallest_excess_is_worse_than_the_worst_within_and_better_than_an_interruption():
    just = np.nextafter(2.0, 3.0)
    these = runs([2.0, np.inf, 1.0], [just, 0.0, 0.0], [0.0, 0.0, 0.0], survived=[np.inf, np.inf, 99.0])
    assert LIMITED.compare(these, only(these, 1)).tolist() == [-1, 0, 1]
    assert LIMITED.cost(these)[2] > 1.0


def standards(*scales):
    terms = [
        Term(name, 0.5, good=1.0, scale=scale, steepness=1.0)
        for name, scale in zip(("error", "effort"), scales, strict=True)
    ]
    return TradeOff(tuple(terms))


RULE = Standards(first=standards(8.0, 8.0), final=standards(2.0, 2.0))


def scales(person):
    return [term.scale for term in person.now.terms]


def test_standards_rise_to_the_better_run_and_no_further_than_the_final_ones():
    person = RULE.person()
    assert scales(person) == [8.0, 8.0]
    assert person.compare(runs([5.0, 20.0]), runs([30.0, 30.0]))[0] == -1
    assert scales(person) == [4.0, 8.0]  # the distances of the better run are 4 and 19
    assert person.compare(runs([30.0, 30.0]), runs([4.0, 1.5]))[0] == 1
    assert scales(person) == [3.0, 2.0]  # 3, and not below the final 2
    person.compare(runs([1.0, 1.0]), runs([1.0, 1.0]))
    assert scales(person) == [2.0, 2.0]


def test_an_answer_is_by_the_standards_before_it():
    one, other = runs([1.9, 8.0]), runs([2.9, 5.0])
    # costs by 8: 0.101 + 0.233 and 0.096 + 0.167; by 2: 0.155 + 0.389 and 0.244 + 0.333
    verdicts = {
        Standards(RULE.first, RULE.final).person().compare(one, other)[0],
        RULE.first.compare(one, other)[0],
    }
    assert verdicts == {1}
    late = RULE.person()
    late.compare(runs([1.0, 1.0]), one)
    assert scales(late) == [2.0, 2.0]
    assert late.compare(one, other)[0] == -1


def test_an_interrupted_winner_raises_nothing():
    person = RULE.person()
    person.compare(runs([1.0, 1.0], survived=[3.0]), runs([1.0, 1.0], survived=[2.0]))
    assert scales(person) == [8.0, 8.0]


def test_the_referee_uses_the_final_standards_and_never_changes():
    these = runs([2.0, 8.0], [3.0, 5.0], [np.inf, 1.0])
    assert np.array_equal(RULE.cost(these), RULE.final.cost(these))
    for row in range(3):
        one = only(these, row)
        assert np.array_equal(RULE.compare(these, one), RULE.final.compare(these, one))
    assert scales(RULE.person()) == [8.0, 8.0]


def test_the_cost_of_a_person_is_todays():
    person, these = RULE.person(), runs([2.0, 8.0])
    assert np.array_equal(person.cost(these), RULE.first.cost(these))


@given(any_runs(size=6))
def test_standards_only_rise_for_any_runs(these):
    rule = RULES["standards"]
    person = rule.person()
    before = scales(person)
    for row in range(5):
        person.compare(only(these, row), only(these, row + 1))
        now = scales(person)
        assert all(
            term.scale <= new <= old for term, new, old in zip(rule.final.terms, now, before, strict=True)
        )
        before = now
