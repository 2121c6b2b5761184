"""PPO and SAC as bandits go through the contract suite of value-based agents, with few updates."""

from functools import partial

import pytest

from contracts.value_agents import *  # noqa: F403
from prefcal_agents.rl import PPOBandit, SACBandit
from support.extras import need


@pytest.fixture(params=["PPO", "SAC"])
def make_agent(request):
    need("rl")
    if request.param == "PPO":
        return partial(PPOBandit, n_steps=2, n_epochs=2)
    return partial(SACBandit, gradient_steps=1)
