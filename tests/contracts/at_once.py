"""What every agent must satisfy if several experiments are pending. Part of the suite `memory`."""

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from contracts.proposals import MIXED, TINY, reply
from prefcal_agents.agent import AgentState
from prefcal_env.errors import ProtocolError, SettingsError
from support.agents import woken


def close(agent, n, choice):
    """Answer number `choice` of the open queries, as if its experiment were ready first."""
    queries = agent.ask(n)
    query = queries[choice % len(queries)]
    agent.tell(query, reply(agent, query))
    return query


def waiting(agent):
    """The θ that have no answer yet, in the order asked."""
    history = agent.history
    return [sample.theta for sample in history.samples[history.answered :]]


def test_several_experiments_are_asked_for_and_asking_again_changes_nothing(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    assert agent.ask(1) == [agent.ask()]
    queries = agent.ask(4)
    assert len({query.challenger for query in queries}) == 4
    assert queries[0] == agent.ask() == agent.ask(2)[0]
    assert agent.ask(4) == queries
    assert {query.incumbent for query in queries} == {None}


@pytest.mark.parametrize("n", [0, -1, 1.5, "2", True])
def test_an_impossible_number_of_pending_experiments_is_refused(make_agent, n):
    with pytest.raises(SettingsError, match="n must be"):
        make_agent(MIXED, n_init=3, n_max=9).ask(n)


def test_the_order_of_the_answers_is_that_of_the_record(make_agent):
    agent, told = make_agent(MIXED, n_init=3, n_max=9), []
    for choice in (2, 3, 0, 1, 1):
        query = close(agent, 4, choice)
        if not query.further:
            told.append(tuple(query.challenger.theta))
    assert [tuple(theta) for theta in agent.samples] == told


def test_no_more_is_pending_than_is_left(make_agent):
    agent = make_agent(TINY, n_init=4, n_max=50)
    tried = set()
    while not agent.done:
        assert len(waiting(agent)) <= agent.n_max - agent.history.answered
        tried.add(tuple(close(agent, 4, -1).challenger.theta))
    assert len(tried) == len(agent.samples) == 6


def test_a_query_that_was_answered_is_refused_though_others_are_open(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    query = close(agent, 3, 1)
    with pytest.raises(ProtocolError, match="the open query is"):
        agent.tell(query, reply(agent, query))


def test_an_undo_keeps_what_was_pending_before_and_drops_what_was_proposed_since(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    agent.ask(3)
    first, second, third = waiting(agent)
    close(agent, 3, 1)
    assert len(agent.ask(3)) == 3
    agent.undo()
    assert waiting(agent) == [second, first, third]


def test_a_retraction_keeps_all_that_is_pending(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    for choice in (0, 2, 1):
        close(agent, 3, choice)
    agent.ask(3)
    before = waiting(agent)
    agent.retract(agent.history.answered - 1)
    assert waiting(agent) == before


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    actions=st.lists(st.one_of(st.integers(0, 3), st.sampled_from(["undo", "save"])), max_size=16),
    n=st.integers(2, 4),
)
def test_in_any_order_of_completion_a_saved_study_continues_the_same(make_agent, actions, n):
    agent = make_agent(MIXED, n_init=3, n_max=7, seed=4)
    for action in actions:
        if action == "undo" and agent.history.answered:
            agent.undo()
        elif action == "save":
            plain = json.loads(json.dumps(agent.state.to_dict()))
            twin = woken(agent, MIXED, AgentState.from_dict(plain))
            assert agent.done or twin.ask(n) == agent.ask(n)
            agent = twin
        elif action != "undo" and not agent.done:
            close(agent, n, action)
        samples = agent.state.history.samples
        assert len({sample.theta for sample in samples}) == len(samples)
        assert agent.copy().state == agent.state
