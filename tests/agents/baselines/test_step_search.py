"""StepSearch is the agent of docs/own_agent.py, and steps away from the best θ."""

import runpy
from pathlib import Path

import numpy as np

from contracts.agents import MIXED
from prefcal_agents.baselines import StepSearch

OWN = Path(__file__).parents[3] / "docs" / "own_agent.py"


def _tried(agent, wished):
    """Return every sample of a study in which the θ nearest to `wished` is preferred."""
    found = []
    while not agent.done:
        query = agent.ask()
        found.append(np.asarray(query.challenger.theta))
        new, best = (
            None if s is None else np.abs(agent.space.encode(s.theta) - wished).max()
            for s in (query.challenger, query.incumbent)
        )
        agent.tell(query, None if best is None else int(np.sign(new - best)))
    return np.array(found)


def test_it_proposes_what_the_agent_of_the_docs_does():
    theirs = runpy.run_path(str(OWN))["StepSearch"]
    for seed in (0, 1):
        ours = _tried(StepSearch(MIXED, n_init=3, n_max=15, seed=seed), 0.3)
        assert np.array_equal(ours, _tried(theirs(MIXED, n_init=3, n_max=15, seed=seed), 0.3))
