"""The agent of docs/own_agent.md goes through the contract suite, as its reader is told to do."""

import importlib.util
from pathlib import Path

import pytest

from contracts.agents import *  # noqa: F403

FILE = Path(__file__).parents[1] / "docs" / "own_agent.py"


@pytest.fixture(scope="module")
def make_agent():
    spec = importlib.util.spec_from_file_location("own_agent", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.StepSearch
