"""What a screening agent says of its result."""

import numpy as np
import pytest

from contracts.agents import MIXED
from prefcal_agents import Screening
from prefcal_agents.result import decisive, turned
from prefcal_env.knobs import Knob, KnobSpace
from support.agents import quick


def by_first(query):
    """The answer of a person who looks at the KPI "first"; the others matter little."""
    if query.incumbent is None:
        return None
    costs = [
        quick(s.theta)["first"] + 0.01 * quick(s.theta)["others"] for s in (query.challenger, query.incumbent)
    ]
    return int(np.sign(costs[0] - costs[1]))


@pytest.fixture(scope="module")
def ended():
    agent = Screening(MIXED, simulate=quick, n_simulated=100, n_max=8, seed=0)
    assert (agent.influences, agent.stakes, agent.menu, agent.wishes) == ((), None, {}, {})
    while not agent.done:
        query = agent.ask()
        stakes = agent.stakes
        assert (stakes is None) == (query.incumbent is None)
        agent.tell(query, by_first(query))
        if stakes is not None and stakes < 0.05:
            assert agent.best_index == query.incumbent.index
    return agent


def test_turning_the_decisive_answer_gives_what_was_foretold(ended):
    named = decisive(ended.influences, ended.best_index)
    assert named is not None
    agent = ended.copy()
    agent.history = turned(ended.history, named.answer)
    assert agent.best_index == named.reversed != ended.best_index
    assert ended.stakes is None  # nothing is asked any more


def test_the_menu_holds_others_with_what_they_gain(ended):
    best = quick(ended.best)
    for row, gained in ended.menu.items():
        theta = ended.bank.thetas[row]
        assert not np.array_equal(theta, ended.best)
        assert all(quick(theta)[name] < best[name] for name in gained)


def test_what_decided_is_what_was_wanted(ended):
    assert ended.wishes["first"] > 0.9


def test_knobs_that_no_kpi_depends_on_stay_as_they_were():
    def simulate(theta):
        return {"first": (theta[0] - 0.3) ** 2, "others": 0.0 * theta[1]}

    space = KnobSpace([Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0), Knob("c", 0.0, 1.0)])
    agent = Screening(space, simulate=simulate, n_simulated=100, n_max=8, seed=0, start=[[0.9, 0.2, 0.7]])
    assert agent.smaller_change is None
    while not agent.done:
        query = agent.ask()
        sides = [s and simulate(s.theta)["first"] for s in (query.challenger, query.incumbent)]
        agent.tell(query, None if sides[1] is None else int(np.sign(sides[0] - sides[1])))
    found = agent.smaller_change
    assert found.kept == (1, 2)
    assert found.theta == (agent.best[0], 0.2, 0.7)
    assert found.chance == 0.0
    bank = agent.with_simulated(np.array([found.theta]))
    assert len(bank) == len(agent.bank) + 1
    assert bank.find(found.theta) == len(agent.bank)


def test_a_result_without_a_given_start_is_compared_with_nothing(ended):
    assert ended.best_index != 0
    assert ended.smaller_change is None


def test_a_requested_theta_that_was_not_simulated_says_nothing():
    agent = Screening(MIXED, simulate=quick, n_simulated=60, n_max=6, seed=0)
    for _ in range(3):
        query = agent.ask()
        agent.tell(query, by_first(query))
    agent.ask()
    free = KnobSpace.decode(MIXED, np.full(len(MIXED), 0.123))
    agent.replace_pending(MIXED.decode(MIXED.snap(MIXED.encode(free))))
    assert agent.stakes is None
