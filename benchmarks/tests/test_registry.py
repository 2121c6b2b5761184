"""Agents of other people's packages are known by name, and loaded when named."""

import pytest

from bench_support.extras import need
from prefcal_agents.registry import agent_class
from prefcal_bench.peers import BANDITS, PEERS
from prefcal_env.errors import SettingsError
from support.agents import assert_a_state_wakes_up
from support.new_process import loaded_by


@pytest.mark.parametrize("row", [*BANDITS, *PEERS], ids=lambda row: row.name)
def test_a_state_wakes_up_the_agent_that_it_was_taken_from(row):
    need(row.extra)
    assert_a_state_wakes_up(row)


def test_an_unknown_name_is_refused_with_theirs_among_the_known():
    with pytest.raises(SettingsError, match="PPOBandit"):
        agent_class("Nobody")


def test_importing_the_agents_loads_no_extra():
    foreign = ("glis", "pyswarm", "optuna", "optuna_dashboard", "torch", "stable_baselines3")
    assert loaded_by("prefcal_bench.peers, prefcal_bench.rl", *foreign) == []
