"""Every agent goes through the contract suite."""

import pytest

from contracts.agents import *  # noqa: F403
from contracts.agents_memory import *  # noqa: F403
from prefcal_agents import GLISp, LatinHypercube, RandomSearch


@pytest.fixture(
    params=[GLISp, GLISp.paper, RandomSearch, LatinHypercube],
    ids=["GLISp", "GLISp.paper", "RandomSearch", "LatinHypercube"],
)
def make_agent(request):
    return request.param
