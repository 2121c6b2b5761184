"""Why an experiment is shown."""

import numpy as np
import pytest

from contracts.agents import MIXED
from prefcal_agents import Screening
from prefcal_agents.screening.agent import chances, reason_for
from prefcal_agents.screening.bank import Growth, Simulations
from prefcal_env.preferences.history import History
from support.agents import quick
from support.simulated import SQUARE, in_chain


def by_first(query):
    """The answer of a person who looks at the KPI "first"; the others matter little."""
    if query.incumbent is None:
        return None
    costs = [
        quick(s.theta)["first"] + 0.01 * quick(s.theta)["others"] for s in (query.challenger, query.incumbent)
    ]
    return int(np.sign(costs[0] - costs[1]))


def trade_off(theta):
    x, y = theta
    return {"a": 0.1 + x, "b": 1.1 - x, "c": 0.1 + y, "same": 1.0}


def staged(answers=()):
    """A stage after a chain of answers about the first rows of the bank."""
    grown = Growth(Simulations(trade_off), SQUARE, 100, 0)
    bank = grown.stage(History()).bank
    rows = range(len(answers) + 1)
    return grown.stage(in_chain(bank, rows, answers) if answers else History())


@pytest.mark.parametrize("seed", range(3))
def test_what_is_said_of_a_pair_is_true_of_it(seed):
    agent, said = Screening(MIXED, simulate=quick, n_simulated=60, n_max=6, seed=seed), 0
    while not agent.done:
        query, reason = agent.ask(), agent.reason
        if query.incumbent is None:
            assert reason is None
        elif reason is not None:
            new, best = quick(query.challenger.theta), quick(query.incumbent.theta)
            assert all(new[name] < best[name] for name in reason.better_in)
            assert all(new[name] > best[name] for name in reason.worse_in)
            assert 0 <= reason.chance <= 1
            said += bool(reason.better_in or reason.worse_in)
        agent.tell(query, by_first(query))
    assert said >= 4
    assert agent.reason is None


def test_a_pair_is_described_by_the_kpis_that_differ_and_no_others():
    stage = staged()
    order = np.argsort(stage.bank.thetas[:, 0])
    low, high = int(order[0]), int(order[-1])
    y = stage.bank.thetas[:, 1]
    reason = reason_for(stage, low, high, History())
    assert "a" in reason.better_in
    assert "b" in reason.worse_in
    assert ("c" in reason.better_in, "c" in reason.worse_in) == (y[low] < y[high], y[low] > y[high])
    assert "same" not in (*reason.better_in, *reason.worse_in)
    back = reason_for(stage, high, low, History())
    assert (back.better_in, back.worse_in) == (reason.worse_in, reason.better_in)


def test_an_experiment_compared_with_itself_is_better_in_nothing():
    stage = staged()
    reason = reason_for(stage, 4, 4, History())
    assert reason.better_in == reason.worse_in == ()
    assert reason.chance < 0.2  # it would have to be noticeably better


def test_chances_are_probabilities_and_follow_the_costs():
    stage = staged((-1, 1, -1))
    found = chances(stage, 2, History())
    assert found.shape == (len(stage.bank),)
    assert np.all((found >= 0) & (found <= 1))
    below = (stage.costs < stage.costs[:, [2]]).mean(axis=0)
    assert np.all(found <= below + 0.2)
    assert np.corrcoef(found, below)[0, 1] > 0.95


def test_a_theta_that_is_better_in_every_kpi_is_surely_better():
    grown = Growth(Simulations(lambda t: {"a": 0.1 + t[0], "b": 1 + 5 * t[0]}), SQUARE, 60, 0)
    stage = grown.stage(History())
    order = np.argsort(stage.bank.thetas[:, 0])
    first, last = int(order[0]), int(order[-1])
    reason = reason_for(stage, first, last, History())
    assert set(reason.better_in) == {"a", "b"}
    assert reason.worse_in == ()
    assert reason.chance > 0.95
    assert reason_for(stage, last, first, History()).chance < 0.05


def test_somebody_who_often_sees_no_difference_is_expected_to_see_one_less_often():
    stage = staged()
    order = np.argsort(stage.bank.thetas[:, 0] + stage.bank.thetas[:, 1])
    pair = int(order[0]), int(order[-1])
    ties = in_chain(stage.bank, range(5), (0, 0, -1, 0))
    sure = reason_for(stage, *pair, History()).chance
    assert reason_for(stage, *pair, ties).chance == pytest.approx(2 / 5 * sure)
