"""The other people's agents that learn from preferences go through the contract suite."""

import pytest

from contracts.agents import *  # noqa: F403
from contracts.agents_memory import *  # noqa: F403
from prefcal_agents.peers import OptunaPreferential, ReferenceGLISp
from support.extras import quick_peers  # noqa: F401


@pytest.fixture(params=[ReferenceGLISp, OptunaPreferential])
def make_agent(request, quick_peers):  # noqa: F811
    return request.param
