"""The other people's agent that is told scores goes through the contract suite."""

import pytest

from contracts.value_agents import *  # noqa: F403
from prefcal_agents.peers import ReferenceGLIS
from support.extras import quick_peers  # noqa: F401


@pytest.fixture
def make_agent(quick_peers):  # noqa: F811
    return ReferenceGLIS
