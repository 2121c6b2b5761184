"""The registry of agents: each is known by name, and loaded when named."""

import pytest

import prefcal_agents
from contracts.proposals import MIXED
from prefcal_agents import restore
from prefcal_agents.registry import AGENTS, agent_class
from prefcal_env.errors import SettingsError
from support.agents import assert_a_state_wakes_up, quick
from support.new_process import loaded_by


@pytest.mark.parametrize("row", [row for row in AGENTS if "." not in row.name], ids=lambda row: row.name)
def test_a_state_wakes_up_the_agent_that_it_was_taken_from(row):
    assert_a_state_wakes_up(row)


def test_an_agent_that_does_not_simulate_takes_no_simulate():
    with pytest.raises(SettingsError, match="RandomSearch takes no simulate"):
        restore(MIXED, prefcal_agents.RandomSearch(MIXED).state, simulate=quick)


def test_unknown_names_are_refused():
    with pytest.raises(SettingsError, match="RandomSearch"):
        agent_class("Nobody")
    with pytest.raises(AttributeError, match="Nobody"):
        _ = prefcal_agents.Nobody


def test_importing_the_agents_loads_no_extra():
    assert loaded_by("prefcal_agents", "torch", "stable_baselines3", "pandas", "matplotlib") == []
