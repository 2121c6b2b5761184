"""The registry of agents: each is known by name, and loaded when named."""

import subprocess
import sys

import pytest

import prefcal_agents
from contracts.agents import MIXED
from prefcal_agents import restore
from prefcal_agents.registry import CLASSES, agent_class
from prefcal_env.errors import SettingsError
from support.agents import maker, quick
from support.extras import need


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.peers) if CLASSES[n].extra else n for n in CLASSES]
)
def test_a_state_wakes_up_the_agent_that_it_was_taken_from(name):
    if CLASSES[name].extra:
        need(CLASSES[name].extra)
    agent = maker(CLASSES[name])(MIXED, n_init=2, n_max=4, seed=7)
    twin = restore(MIXED, agent.state)
    assert type(twin) is type(agent)
    assert twin.ask() == agent.ask()


def test_an_agent_that_does_not_simulate_takes_no_simulate():
    with pytest.raises(SettingsError, match="RandomSearch takes no simulate"):
        restore(MIXED, prefcal_agents.RandomSearch(MIXED).state, simulate=quick)


def test_unknown_names_are_refused():
    with pytest.raises(SettingsError, match="PPOBandit"):
        agent_class("Nobody")
    with pytest.raises(AttributeError, match="Nobody"):
        _ = prefcal_agents.Nobody


def test_importing_the_agents_loads_no_extra():
    foreign = ("glis", "pyswarm", "optuna", "optuna_dashboard", "torch", "stable_baselines3")
    code = (
        "import sys, prefcal_agents, prefcal_bench.peers, prefcal_agents.rl\n"
        f"print([m for m in {foreign!r} if m in sys.modules])"
    )
    path = [p for p in sys.path if p]
    program = f"import sys; sys.path[:0] = {path!r}\n{code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
