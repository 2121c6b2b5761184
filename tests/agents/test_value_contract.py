"""Every agent of the registry that learns from scores goes through the contract suite."""

import pytest

from contracts.value_agents import *  # noqa: F403
from support.agents import agents_without_extra

AGENTS = agents_without_extra(by_value=True)


@pytest.fixture(params=AGENTS.values(), ids=AGENTS)
def make_agent(request):
    return request.param
