import numpy as np
import pytest
from hypothesis import given

from prefcal_bench.people.rising import Standards
from prefcal_bench.people.weighted import Term, Weighted
from support.people import RULES, any_runs, only, runs

pytestmark = pytest.mark.filterwarnings("error")


def standards(*scales):
    terms = [
        Term(name, 0.5, good=1.0, scale=scale, steepness=1.0)
        for name, scale in zip(("error", "effort"), scales, strict=True)
    ]
    return Weighted(tuple(terms))


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
