"""What every preference-based agent must remember: undo, retraction, twins, saved states.

Used like `agents`, which holds the rest of the suite; what agents that are told scores must
remember as well is in `memory`.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from contracts.memory import *  # noqa: F403
from contracts.proposals import HALF, MIXED, SMALL, run
from prefcal_agents import Screening
from prefcal_agents.agent import AgentState
from prefcal_env.errors import ProtocolError, SettingsError
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import Sample
from support.agents import woken


def test_after_undo_another_answer_may_be_given(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    run(agent, [None, -1])
    agent.undo()
    run(agent, [1])
    assert agent.ask().incumbent.index == 0


def assert_winner(agent, query, index):
    """The query's incumbent has won, unless the agent takes one of the answers for a mistake."""
    assert agent.history.by_answers == index
    assert query.incumbent.index == agent.history.incumbent
    assert agent.history.incumbent == index or (agent.history.leads and isinstance(agent, Screening))


def test_retracting_keeps_all_samples_and_recomputes_the_incumbent(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=8)
    run(agent, [None, -1, -1, 1, 0])
    before, query = agent.state, agent.ask()
    assert_winner(agent, query, 2)
    agent.retract(2)
    assert agent.state.history.samples == before.history.samples
    assert agent.ask().challenger == query.challenger
    assert_winner(agent, agent.ask(), 1)
    if agent.ask() == query:  # the mistake that is not one now was taken for one before
        query = replace(query, incumbent=query.challenger)
    with pytest.raises(ProtocolError, match="open query is"):
        agent.tell(query, 0)
    run(agent)
    assert agent.done


def test_retracting_does_not_depend_on_whether_was_asked(make_agent):
    asked, silent = make_agent(MIXED, n_init=2, n_max=8), make_agent(MIXED, n_init=2, n_max=8)
    for agent in (asked, silent):
        run(agent, [None, -1, -1, 1])
    asked.ask()
    for agent in (asked, silent):
        agent.retract(1)
    assert asked.state == silent.state


@pytest.mark.parametrize("index", [-1, 4, 1.0, "1", None, True])
def test_retracting_what_does_not_exist_is_refused(make_agent, index):
    agent = make_agent(MIXED, n_init=3, n_max=8)
    run(agent, [None, -1, -1, 1])
    with pytest.raises(ProtocolError):
        agent.retract(index)


def test_retracting_twice_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=8)
    run(agent, [None, -1])
    agent.retract(1)
    with pytest.raises(ProtocolError, match="already"):
        agent.retract(1)


def test_undo_after_a_retraction_reopens_the_last_query(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=8)
    queries = run(agent, [None, -1, 1, 1])
    agent.retract(1)
    agent.undo()
    assert agent.ask().challenger == queries[3].challenger
    assert agent.ask().incumbent.index == 0


def test_a_copy_is_independent(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [None, -1, 1, -1])
    query, state = agent.ask(), agent.state
    twins = {answer: agent.copy() for answer in (-1, 0, 1)}
    for answer, twin in twins.items():
        twin.tell(twin.ask(), answer)
        twin.ask()
    assert agent.ask() == query
    assert agent.state == state
    agent.tell(query, -1)
    assert agent.ask() == twins[-1].ask()
    assert twins[-1].ask().incumbent != twins[1].ask().incumbent


def test_a_state_keeps_marks_strengths_and_outcomes(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    told = Answer(1, 0.5, (Mark.CHALLENGER_UNSAFE,), ({"t": np.inf}, {"t": 1.0}))
    run(agent, [Answer(None, outcomes=({"t": 1.0, "u": 2.0}, None)), told])
    state = AgentState.from_dict(json.loads(json.dumps(agent.state.to_dict())))
    assert state.history.comparisons[1].answer == told
    assert state == agent.state


def test_an_older_algorithms_samples_are_kept(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [None, -1, 1])
    moved = tuple(
        Sample.of(MIXED, np.array([*sample.z[:-1], 0.125])) for sample in agent.state.history.samples
    )
    old = replace(agent.state, version=0, history=replace(agent.state.history, samples=moved))
    twin = woken(agent, MIXED, old)
    assert twin.state.history.samples == moved
    assert twin.ask().challenger.theta[2] == pytest.approx(-4.0)
    run(twin)
    assert twin.done


def test_a_state_that_does_not_fit_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [None, -1, 1])
    with pytest.raises(SettingsError, match="sample 0"):
        type(agent).restore(SMALL, agent.state)
    good = agent.state.to_dict()
    first, (alone, answer, _) = good["history"]["samples"][0], good["history"]["comparisons"]
    for bad in (
        {},
        {**good, "agent": "Nobody"},
        {**good, "n_max": 2},
        {**good, "seed": -1},
        *(
            {**good, "history": {**good["history"], **change}}
            for change in (
                {"samples": [first]},
                {"comparisons": [alone, {**answer, "incumbent": 2}]},
                {"comparisons": [alone, {**answer, "challenger": 2}]},
                {"comparisons": [alone, {**answer, "answer": {**answer["answer"], "preference": 7}}]},
                {"samples": [{**first, "z": [0.5, 0.5, 1.5]}] * 4},
                {"samples": [{**first, "z": [0.1, 0.9, 0.1]}] * 4},
                {"samples": [{**first, "theta": [0.5, 0.5, "x"]}] * 4},
                {"samples": [[0.5, 0.5, 0.5]] * 4},
            )
        ),
    ):
        with pytest.raises(SettingsError):
            type(agent).restore(MIXED, AgentState.from_dict(bad))


def test_a_state_of_theta_that_are_not_allowed_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=4, n_max=9, seed=2)
    assert not all(HALF.allows(query.challenger.theta) for query in run(agent))
    with pytest.raises(SettingsError, match=r"sample .* of a state: constraint 'sum' must be 0"):
        type(agent).restore(HALF, agent.state)
