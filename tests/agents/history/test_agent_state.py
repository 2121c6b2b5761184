"""States of agents that cannot be read are refused with the reason."""

import pytest

from prefcal_agents import AgentState, RandomSearch
from prefcal_env import Knob, KnobSpace
from prefcal_env.errors import SettingsError
from support.studies import drive


def test_a_state_of_an_earlier_version_is_refused_with_what_to_do():
    agent = RandomSearch(KnobSpace([Knob("x", 0, 1)]), n_init=2, n_max=4)
    drive(agent, lambda new, old: 1)
    plain = agent.state.to_dict()
    assert AgentState.from_dict(plain) == agent.state
    plain["samples"][0] = plain["samples"][0]["z"]  # as it was before
    with pytest.raises(SettingsError, match=r"z and theta by name, got \[.*made anew"):
        AgentState.from_dict(plain)
