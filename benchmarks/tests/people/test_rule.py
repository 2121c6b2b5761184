"""What every rule promises for any runs: values of 0 or more, infinite ones, interruptions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_support.people import RULES, any_runs, only, runs
from prefcal_bench.people.rule import minus, sign, survival

every = pytest.mark.parametrize("rule", RULES.values(), ids=list(RULES))
pytestmark = pytest.mark.filterwarnings("error")


@every
@given(any_runs())
def test_any_runs_are_compared_alike_from_both_sides_and_one_by_one(rule, every_run):
    count = len(every_run)
    verdicts = [rule.compare(every_run, only(every_run, row)) for row in range(count)]
    for a in range(count):
        assert verdicts[a][a] == 0
        for b in range(count):
            one_by_one = rule.compare(only(every_run, b), only(every_run, a))
            assert verdicts[a][b] == one_by_one[0] == -verdicts[b][a]


@every
@given(any_runs())
def test_who_survives_longer_is_better(rule, every_run):
    backwards = every_run.take(np.arange(len(every_run))[::-1])
    verdicts = rule.compare(every_run, backwards)
    for verdict, mine, other in zip(verdicts, every_run.survived, backwards.survived, strict=True):
        if mine != other:
            assert verdict == (1 if mine < other else -1)
        elif np.isfinite(mine):
            assert verdict == 0


@every
@given(any_runs())
def test_a_cost_is_finite_and_has_the_order_of_the_comparisons(rule, every_run):
    cost = rule.cost(every_run)
    if cost is None:
        return
    assert np.isfinite(cost).all()
    assert (cost >= 0).all()
    assert ((cost > 1) == np.isfinite(every_run.survived)).all()
    for row in range(len(every_run)):
        assert np.array_equal(rule.compare(every_run, only(every_run, row)), np.sign(cost - cost[row]))


@every
@given(st.lists(st.floats(0.0, 1e9), min_size=3, max_size=3))
def test_a_run_that_is_better_in_everything_never_loses(rule, row):
    better, worse = runs(row), runs([value + 1.0 for value in row])
    assert rule.compare(better, worse)[0] <= 0


def test_two_infinite_values_differ_by_nothing():
    infinite = np.array([np.inf, np.inf, 1.0, -np.inf])
    assert minus(infinite, np.array([np.inf, 1.0, np.inf, -np.inf])).tolist() == [0.0, np.inf, -np.inf, 0.0]
    assert sign(np.array([-np.inf, -0.0, 3.0])).tolist() == [-1, 0, 1]


def test_survival_by_hand():
    a, b = (runs(*[[0.0]] * 4, survived=s) for s in ([np.inf, 2, 3, 2], [np.inf, np.inf, 2, 2]))
    assert survival(a, b).tolist() == [0, 1, -1, 0]
