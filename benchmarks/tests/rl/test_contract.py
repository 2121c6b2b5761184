"""PPO and SAC as bandits go through the contract suite of value-based agents, with few updates."""

import pytest

from bench_support.extras import need
from contracts.value_agents import *  # noqa: F403
from prefcal_bench.rl import PPOBandit, SACBandit, bandits


@pytest.fixture(params=[PPOBandit, SACBandit])
def make_agent(request, monkeypatch):
    need("rl")
    monkeypatch.setattr(bandits, "PPO_STEPS", 2)
    monkeypatch.setattr(bandits, "SAC_STEPS", 1)
    return request.param
