"""What every agent must remember, whether it is told preferences or scores.

Part of the suites `agents_memory` and `value_agents`.
"""

import copy
import json
import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from contracts.at_once import *  # noqa: F403
from contracts.proposals import MIXED, reply
from prefcal_agents.agent import AgentState
from prefcal_env.errors import ProtocolError
from prefcal_env.preferences.answer import Answer
from support.agents import woken


def told(agent):
    """Something of every kind that can be told."""
    if agent.by_value:
        return [0.5, None, 1000.25, -1.5, 3, 2.0, None, 7.0]
    return [None, -1, Answer(1, strength=2.5), None, 0, -1, 1, 1]


def test_undo_reopens_the_identical_query(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=7)
    states, queries = [], []
    while not agent.done:
        states.append(agent.state)
        queries.append(agent.ask())
        agent.tell(queries[-1], reply(agent, queries[-1]))
    for state, query in zip(reversed(states), reversed(queries), strict=True):
        agent.undo()
        assert agent.ask() == query
        assert agent.state == state
    with pytest.raises(ProtocolError, match="no answer to undo"):
        agent.undo()


@pytest.mark.parametrize("how", [copy.deepcopy, lambda agent: pickle.loads(pickle.dumps(agent))])
def test_an_agent_can_be_pickled_and_deep_copied_and_goes_on_alike(make_agent, how):
    agent = make_agent(MIXED, n_init=3, n_max=7)
    for answer in told(agent)[:5]:
        agent.tell(agent.ask(), answer)
    twin = how(agent)
    assert type(twin) is type(agent)
    assert twin.state == agent.state
    assert twin.ask() == agent.ask()
    twin.tell(twin.ask(), reply(twin, twin.ask()))
    assert twin.state != agent.state  # it is independent
    agent.tell(agent.ask(), reply(agent, agent.ask()))
    assert twin.done or twin.ask() == agent.ask()


@pytest.mark.parametrize("answered", [0, 1, 3, 5, 8])
def test_restoring_from_json_gives_the_identical_next_query(make_agent, answered):
    agent = make_agent(MIXED, n_init=3, n_max=9, seed=5)
    for answer in told(agent)[:answered]:
        agent.tell(agent.ask(), answer)
    if answered > 4:
        agent.retract(2)
    plain = json.loads(json.dumps(agent.state.to_dict()))
    twin = woken(agent, MIXED, AgentState.from_dict(plain))
    assert type(twin) is type(agent)
    assert twin.state == agent.state
    while not agent.done:
        query = agent.ask()
        assert twin.ask() == query
        for a in (agent, twin):
            a.tell(query, reply(agent, query))
    assert np.array_equal(twin.best, agent.best)


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    actions=st.lists(
        st.one_of(st.floats(-1e6, 1e6), st.sampled_from([None, "undo", "retract", "copy", "save"])),
        max_size=25,
    ),
    seed=st.integers(0, 2**40),
)
def test_any_order_of_calls_keeps_the_promises(make_agent, actions, seed):
    agent = make_agent(MIXED, n_init=3, n_max=8, seed=seed)
    for action in actions:
        agent = after(agent, action)
        samples = agent.state.history.samples
        assert len(set(samples)) == len(samples)
        assert agent.state == agent.copy().state
        if not agent.done:
            query = agent.ask()
            assert query.further or query.challenger.index == agent.state.history.answered


def after(agent, action):
    """The agent after one more action; a number is a score, or its sign a preference."""
    comparisons = agent.state.history.comparisons
    if action == "copy":
        return agent.copy()
    if action == "save":
        return woken(agent, MIXED, AgentState.from_dict(agent.state.to_dict()))
    if action == "undo" and comparisons:
        agent.undo()
    if action == "retract" and comparisons and not comparisons[-1].retracted:
        agent.retract(len(comparisons) - 1)
    if action not in ("undo", "retract") and not agent.done:
        preference = None if action is None else int(np.sign(action))
        agent.tell(agent.ask(), action if agent.by_value else preference)
    return agent
