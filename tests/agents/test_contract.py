"""Every agent of the registry that learns from preferences goes through the contract suite."""

import pytest

from contracts.agents import *  # noqa: F403
from contracts.agents_memory import *  # noqa: F403
from support.agents import agents_without_extra

AGENTS = agents_without_extra()


@pytest.fixture(params=AGENTS.values(), ids=AGENTS)
def make_agent(request):
    return request.param
