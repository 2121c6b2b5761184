"""What every value-based agent must satisfy: it is told scores, lower is better.

A test file that imports everything from here and has a fixture `make_agent(space, **options)`
puts its agent through all of it.
"""

import numpy as np
import pytest

from contracts.agents import HALF, MIXED, RARE, RING, SMALL, STAIRS, TINY, latent
from contracts.memory import *  # noqa: F403
from prefcal_agents.agent import AgentState
from prefcal_env.errors import PreferenceError, ProtocolError, SettingsError
from prefcal_env.preferences.answer import Answer


def score(query):
    """The score that someone who knows `latent` gives."""
    return latent(query.challenger.theta)


def run(agent, values=None):
    """Tell scores until done, or each of `values`; return the queries."""
    queries = []
    for value in [score] * (agent.n_max + 1) if values is None else values:
        if agent.done:
            break
        queries.append(agent.ask())
        agent.tell(queries[-1], value(queries[-1]) if callable(value) else value)
    return queries


@pytest.mark.unchecked
@pytest.mark.parametrize("space", [HALF, RING, RARE, STAIRS], ids=["half", "ring", "rare", "stairs"])
def test_every_proposal_is_allowed_by_the_constraints(make_agent, space):
    agent = make_agent(space, n_init=4, n_max=9, seed=2)
    thetas = [space.check_allowed(q.challenger.theta) for q in run(agent)]
    assert len({theta.tobytes() for theta in thetas}) == 9


def test_no_query_has_an_incumbent_and_asking_is_pure(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    queries = []
    while not agent.done:
        queries.append(agent.ask())
        assert agent.ask() == queries[-1]
        agent.tell(queries[-1], score(queries[-1]))
    assert [q.incumbent for q in queries] == [None] * 6
    assert [q.challenger.index for q in queries] == list(range(6))
    with pytest.raises(ProtocolError, match="6 experiments are answered"):
        agent.ask()


def test_the_best_is_the_lowest_score_that_stands(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=8)
    with pytest.raises(ProtocolError, match="before the first answer"):
        _ = agent.best
    queries = run(agent, [5.0, None, -3.0, 2, 1e6])
    assert np.array_equal(agent.best, queries[2].challenger.theta)
    agent.retract(2)
    assert np.array_equal(agent.best, queries[3].challenger.theta)


def test_the_same_seed_gives_the_same_study_and_another_one_does_not(make_agent):
    a, b, c = (run(make_agent(MIXED, n_init=4, n_max=8, seed=s)) for s in (3, 3, 4))
    assert a == b
    assert a != c


@pytest.mark.parametrize("value", [np.nan, np.inf, "low", True, [1.0], Answer(-1)])
def test_something_that_is_no_score_is_refused(make_agent, value):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    query = agent.ask()
    with pytest.raises(PreferenceError):
        agent.tell(query, value)
    assert agent.ask() == query


def test_a_stale_query_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    stale = agent.ask()
    agent.tell(stale, 1.0)
    before = agent.state
    with pytest.raises(ProtocolError, match="open query is"):
        agent.tell(stale, 1.0)
    assert agent.state == before


def test_experiments_without_a_score_teach_nothing_and_the_study_goes_on(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    queries = run(agent, [None] * 9)
    assert agent.done
    assert len({q.challenger for q in queries}) == 9


@pytest.mark.parametrize("space", [MIXED, SMALL])
def test_theta_stays_in_the_box_integers_are_whole_and_none_runs_twice(make_agent, space):
    agent = make_agent(space, n_init=5, n_max=14, seed=2)
    thetas = [space.check(q.challenger.theta) for q in run(agent)]
    assert len({theta.tobytes() for theta in thetas}) == 14


def test_a_space_with_fewer_theta_than_experiments_is_tried_in_full(make_agent):
    agent = make_agent(TINY, n_init=4, n_max=50)
    assert {tuple(q.challenger.theta) for q in run(agent)} == {(a, b) for a in (0, 1, 2) for b in (1, 2)}
    assert agent.done


def test_scores_that_are_all_equal_or_a_world_apart_stop_nothing(make_agent):
    for values in ([1.0] * 12, [1000.5, 0.7] * 6, [1e300, -1e300, 0.0] * 4, [0.0, 1e-300] * 6):
        agent = make_agent(MIXED, n_init=4, n_max=12)
        run(agent, values)
        assert agent.done


def test_a_retraction_keeps_every_sample(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [score] * 6)
    query = agent.ask()
    agent.retract(4)
    assert agent.ask() == query
    run(agent)
    assert agent.done


def test_a_copy_is_independent(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [score] * 4)
    query, state = agent.ask(), agent.state
    twin = agent.copy()
    run(twin)
    assert twin.done
    assert agent.ask() == query
    assert agent.state == state


def test_a_state_that_does_not_fit_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    run(agent, [1.0, 2.0, 3.0])
    good = agent.state.to_dict()
    alone, answer, *_ = good["history"]["comparisons"]
    wrong = {**alone, "answer": {**alone["answer"], "value": "low"}}
    for bad in (
        {**good, "history": {**good["history"], "comparisons": [alone, {**answer, "incumbent": 0}]}},
        {**good, "history": {**good["history"], "comparisons": [wrong]}},
        {**good, "n_max": 2},
    ):
        with pytest.raises(SettingsError):
            type(agent).restore(MIXED, AgentState.from_dict(bad))


@pytest.mark.parametrize("options", [{"n_init": 8, "n_max": 7}, {"n_init": 0}, {"seed": -1}])
def test_impossible_counts_and_seeds_are_refused(make_agent, options):
    with pytest.raises(SettingsError) as refusal:
        make_agent(MIXED, **options)
    assert next(iter(options)) in str(refusal.value)
