"""What every value-based agent must satisfy: it is told scores, lower is better.

A test file that imports everything from here and has a fixture `make_agent(space, **options)`
puts its agent through all of it.
"""

from functools import partial

import numpy as np
import pytest

from contracts.memory import *  # noqa: F403
from contracts.proposals import *  # noqa: F403
from contracts.proposals import MIXED, reply, run
from prefcal_agents.agent import AgentState
from prefcal_env.errors import PreferenceError, ProtocolError, SettingsError
from prefcal_env.preferences.answer import Answer


def test_no_query_has_an_incumbent_and_asking_is_pure(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    queries = []
    while not agent.done:
        queries.append(agent.ask())
        assert agent.ask() == queries[-1]
        agent.tell(queries[-1], reply(agent, queries[-1]))
    assert [q.incumbent for q in queries] == [None] * 6
    assert [q.challenger.index for q in queries] == list(range(6))
    with pytest.raises(ProtocolError, match="6 experiments are answered"):
        agent.ask()


def test_the_best_is_the_lowest_score_that_stands(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=8)
    with pytest.raises(ProtocolError, match="before the first answer"):
        _ = agent.best
    queries = run(agent, [5.0, None, -3.0, 2, 1e6])
    assert np.array_equal(agent.best, queries[2].challenger.theta)
    agent.retract(2)
    assert np.array_equal(agent.best, queries[3].challenger.theta)


@pytest.mark.parametrize("value", [np.nan, np.inf, "low", True, [1.0], Answer(-1)])
def test_something_that_is_no_score_is_refused(make_agent, value):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    query = agent.ask()
    with pytest.raises(PreferenceError):
        agent.tell(query, value)
    assert agent.ask() == query


def test_experiments_without_a_score_teach_nothing_and_the_study_goes_on(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    queries = run(agent, [None] * 9)
    assert agent.done
    assert len({q.challenger for q in queries}) == 9


def test_scores_that_are_all_equal_or_a_world_apart_stop_nothing(make_agent):
    for values in ([1.0] * 12, [1000.5, 0.7] * 6, [1e300, -1e300, 0.0] * 4, [0.0, 1e-300] * 6):
        agent = make_agent(MIXED, n_init=4, n_max=12)
        run(agent, values)
        assert agent.done


def test_a_retraction_keeps_every_sample(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [partial(reply, agent)] * 6)
    query = agent.ask()
    agent.retract(4)
    assert agent.ask() == query
    run(agent)
    assert agent.done


def test_a_copy_is_independent(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [partial(reply, agent)] * 4)
    query, state = agent.ask(), agent.state
    twin = agent.copy()
    run(twin)
    assert twin.done
    assert agent.ask() == query
    assert agent.state == state


def test_a_state_that_does_not_fit_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [1.0, 2.0, 3.0])
    good = agent.state.to_dict()
    alone, answer, *_ = good["history"]["comparisons"]
    wrong = {**alone, "answer": {**alone["answer"], "value": "low"}}
    for bad in (
        {**good, "history": {**good["history"], "comparisons": [alone, {**answer, "incumbent": 0}]}},
        {**good, "history": {**good["history"], "comparisons": [wrong]}},
        {**good, "n_max": 2},
    ):
        with pytest.raises(SettingsError):
            type(agent).restore(MIXED, AgentState.from_dict(bad))
