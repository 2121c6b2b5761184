"""Every value-based agent goes through the contract suite."""

import pytest

from contracts.value_agents import *  # noqa: F403
from prefcal_agents import GLIS


@pytest.fixture(params=[GLIS], ids=["GLIS"])
def make_agent(request):
    return request.param
