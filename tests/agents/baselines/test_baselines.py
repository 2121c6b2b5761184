"""EqualWeights learns nothing; StepSearch is the agent of docs/own_agent.py."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from contracts.proposals import MIXED, run
from prefcal_agents.baselines import EqualWeights, StepSearch, by_mean_rank
from prefcal_env.errors import SettingsError
from support.agents import quick


def test_rows_come_by_the_mean_of_their_ranks():
    #                ranks 1, 2, 3, 4   ranks 4, 1, 2.5, 2.5   the sum: 5, 3, 5.5, 6.5
    kpis = np.column_stack([[0.1, 0.2, 0.3, 9.0], [np.inf, 1.0, 2.0, 2.0]])
    assert list(by_mean_rank(kpis)) == [1, 0, 2, 3]


def test_the_size_of_a_difference_does_not_count():
    kpis = np.random.default_rng(0).random((30, 3))
    stretched = np.exp(9 * kpis) * [1.0, 1e-6, 1e6]
    assert list(by_mean_rank(kpis)) == list(by_mean_rank(stretched))


def test_without_kpis_the_order_stays():
    assert list(by_mean_rank(np.zeros((3, 0)))) == [0, 1, 2]


def test_it_shows_its_best_first_and_then_the_next_best_whatever_is_answered():
    agents = [EqualWeights(MIXED, simulate=quick, n_simulated=50, n_max=6) for _ in range(2)]
    first, second = (
        [q.challenger for q in run(a, [None, *says])]
        for a, says in zip(agents, ([1] * 5, [-1] * 5), strict=True)
    )
    assert first == second
    bank = agents[0].bank
    order = by_mean_rank(bank.kpis)[:6]
    assert np.array_equal([shown.theta for shown in first], bank.thetas[order])


def test_without_simulate_it_can_only_be_looked_at():
    agent = EqualWeights(MIXED)
    assert agent.simulate is None
    assert agent.n_simulated == 1000
    for look in (agent.ask, lambda: agent.simulations, lambda: agent.bank):
        with pytest.raises(SettingsError, match="needs simulate"):
            look()


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
