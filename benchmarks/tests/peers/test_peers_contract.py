"""The other people's agents that learn from preferences go through the contract suite."""

import pytest

from bench_support.extras import quick_peers  # noqa: F401
from bench_support.peers import peers
from contracts.agents import *  # noqa: F403
from contracts.agents_memory import *  # noqa: F403

AGENTS = peers()


@pytest.fixture(params=AGENTS.values(), ids=AGENTS)
def make_agent(request, quick_peers):  # noqa: F811
    return request.param
