"""The other people's agents that are told scores go through the contract suite."""

import pytest

from contracts.value_agents import *  # noqa: F403
from support.agents import peers
from support.extras import quick_peers  # noqa: F401

AGENTS = peers(by_value=True)


@pytest.fixture(params=AGENTS.values(), ids=AGENTS)
def make_agent(request, quick_peers):  # noqa: F811
    return request.param
