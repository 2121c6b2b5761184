"""One proposal stays easy to follow: it enters few files and seldom changes between them."""

from functools import partial
from itertools import pairwise

import pytest

import prefcal_agents
import prefcal_env
from prefcal_agents import GLISp, Screening
from prefcal_scenarios.cases.functions import FUNCTIONS
from support.traces import entered_files

PACKAGES = (prefcal_env, prefcal_agents)
FILES, CROSSINGS = 20, 300


def simulated(theta):
    """Simple KPIs of a θ."""
    far = (theta - 0.4) ** 2
    return {"first": float(far[0]), "others": float(far[1:].sum()), "size": float(abs(theta[0]))}


@pytest.mark.parametrize(
    ("make", "experiment"),
    [
        (partial(GLISp, n_init=6, n_max=50), 30),  # each a kind of proposal of its own
        (partial(GLISp, n_init=6, n_max=50), 31),
        (partial(Screening, simulate=simulated), 4),
        (partial(Screening, simulate=simulated), 8),
    ],
)
def test_a_proposal_enters_few_files(make, experiment):
    function = FUNCTIONS["hartman3"]
    agent = make(function.space, seed=0)

    def ask_and_tell():
        query = agent.ask()
        new, best = query.challenger, query.incumbent
        agent.tell(query, None if best is None else function.prefer(new.theta, best.theta))

    for _ in range(experiment - 1):
        ask_and_tell()
    entered = entered_files(ask_and_tell, PACKAGES)
    assert 0 < len(set(entered)) <= FILES
    assert 0 < sum(a != b for a, b in pairwise(entered)) <= CROSSINGS
