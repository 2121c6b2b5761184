"""Warm start: θ that are given are the first samples of every agent."""

import json

import numpy as np
import pytest

from contracts.proposals import MIXED, judge, latent, run
from prefcal_agents import GLIS, GLISp, RandomSearch, restore
from prefcal_agents.agent import AgentState
from prefcal_agents.registry import AGENTS as ROWS
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from support.agents import agents_without_extra, woken

AGENTS = agents_without_extra()

PRESENT = (0.5, 7, -1.0)
OTHER = (2.0, 3, 1.5)


@pytest.fixture(params=AGENTS.values(), ids=AGENTS)
def make_agent(request):
    return request.param


def test_the_present_tuning_is_the_first_experiment(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6, start=PRESENT)
    assert agent.ask().challenger.theta == pytest.approx(PRESENT)
    run(agent)
    assert len(agent.samples) == 6


@pytest.mark.parametrize("name", [row.name for row in ROWS if row.name in AGENTS and not row.simulates])
def test_the_rest_of_the_space_filling_start_is_the_one_that_would_have_been(name):
    agent, cold = (AGENTS[name](MIXED, n_init=3, n_max=6, start=s) for s in (PRESENT, None))
    run(agent)
    run(cold)
    assert agent.samples[1:3] == pytest.approx(cold.samples[1:3])


def test_several_theta_come_in_their_order(make_agent):
    agent = make_agent(MIXED, n_init=1, n_max=4, start=(PRESENT, np.array(OTHER)))
    run(agent)
    assert agent.samples[:2] == pytest.approx(np.array([PRESENT, OTHER]))
    assert len(np.unique(agent.samples, axis=0)) == 4


def test_a_value_based_agent_takes_a_start():
    agent = GLIS(MIXED, n_init=2, n_max=4, start=PRESENT)
    while not agent.done:
        query = agent.ask()
        agent.tell(query, latent(query.challenger.theta))
    assert agent.samples[0] == pytest.approx(PRESENT)


@pytest.mark.parametrize("answered", [0, 1, 2, 4])
def test_a_resumed_study_begins_the_same(make_agent, answered):
    agent = make_agent(MIXED, n_init=3, n_max=6, start=[PRESENT, OTHER])
    run(agent, [judge] * answered)
    stored = json.loads(json.dumps(agent.state.to_dict()))
    again = woken(agent, MIXED, AgentState.from_dict(stored))
    assert again.state == agent.state == agent.copy().state
    run(agent)
    run(again)
    assert again.samples.tolist() == agent.samples.tolist()


def test_a_state_without_a_start_reads_as_before(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    assert "start" not in agent.state.to_dict()
    assert make_agent(MIXED, n_init=3, n_max=6, start=()).state == agent.state


def test_one_knob_takes_one_theta_or_several():
    line = KnobSpace([Knob("x", 0.0, 4.0, "m")])
    assert GLISp(line, start=(3.0,)).ask().challenger.theta == pytest.approx([3.0])
    several = GLISp(line, start=[[3.0], [1.0]])
    run(several, [None])
    assert several.ask().challenger.theta == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("start", "error", "words"),
    [
        ((0.5, 7, -6.0), KnobError, r"start: theta of knob 'weight' must be in \[-5.0, 3.0\]"),
        ([PRESENT, (0.5, 7.5, 0.0)], KnobError, "start θ 2: theta of knob 'horizon'"),
        ((0.5, 7), KnobError, "start: theta must have shape"),
        ((0.5, 7, np.nan), KnobError, "must be finite"),
        ([PRESENT, PRESENT], SettingsError, "twice: number 2"),
        ([PRESENT, (1, 2, 0), (1, 3, 0), (1, 4, 0), (1, 5, 0)], SettingsError, "n_max 4, got 5"),
    ],
)
def test_an_impossible_start_is_refused(start, error, words):
    with pytest.raises(error, match=words):
        GLISp(MIXED, n_init=2, n_max=4, start=start)


@pytest.mark.unchecked
@pytest.mark.parametrize("start", [3.0, "present", {"gain": 1.0}, [[1.0, 2], [3.0]]])
def test_something_else_is_refused(start):
    with pytest.raises((SettingsError, KnobError), match="start"):
        GLISp(MIXED, n_init=2, n_max=4, start=start)


def test_a_malformed_start_of_a_state_is_refused():
    plain = RandomSearch(MIXED, n_init=2, n_max=4, start=PRESENT).state.to_dict()
    with pytest.raises(SettingsError, match="start of a state"):
        restore(MIXED, AgentState.from_dict({**plain, "start": [[0.5, 2.0, 0.5]]}))
    with pytest.raises(SettingsError, match="cannot be read"):
        AgentState.from_dict({**plain, "start": 3})
