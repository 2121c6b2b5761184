"""What every preference-based agent must satisfy.

A test file that imports everything from here and has a fixture `make_agent(space, **options)`
puts its agent through all of it. What an agent must remember stands in `agents_memory`.
"""

import numpy as np
import pytest

from contracts.proposals import *  # noqa: F403
from contracts.proposals import MIXED, judge, latent, run
from prefcal_env.errors import KnobError, PreferenceError, ProtocolError, SettingsError
from prefcal_env.knobs import Constraint, Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark, Preference


def test_asking_is_pure(make_agent):
    asked, silent = make_agent(MIXED, n_init=3, n_max=6), make_agent(MIXED, n_init=3, n_max=6)
    before = silent.state
    for _ in range(6):
        query = asked.ask()
        assert asked.ask() == query
        assert asked.ask() == query
        asked.tell(query, judge(query))
        query = silent.ask()
        silent.tell(query, judge(query))
    assert asked.state == silent.state
    assert make_agent(MIXED, n_init=3, n_max=6).state == before


def test_the_first_query_has_no_incumbent_and_any_answer_closes_it(make_agent):
    for answer in (-1, 0, 1, None, Answer(None, marks=(Mark.CHALLENGER_UNSAFE,))):
        agent = make_agent(MIXED, n_init=3, n_max=6)
        first = agent.ask()
        assert first.incumbent is None
        assert first.challenger.index == 0
        agent.tell(first, answer)
        assert agent.ask().incumbent == first.challenger
        assert np.array_equal(agent.best, first.challenger.theta)


@pytest.mark.parametrize("seed", range(3))
def test_a_sure_hand_is_never_shown_a_loser_as_the_best_and_gets_the_best_of_all(make_agent, seed):
    agent, lost, costs = make_agent(MIXED, n_init=4, n_max=14, seed=seed), set(), {}
    while not agent.done:
        query = agent.ask()
        costs[query.challenger.index] = latent(query.challenger.theta)
        assert agent.best_index not in lost
        if query.incumbent is not None:
            assert query.further or query.incumbent.index == agent.best_index
            pair = (query.challenger.index, query.incumbent.index)
            lost.add(max(pair, key=costs.__getitem__))
        agent.tell(query, judge(query))
    assert agent.best_index == min(costs, key=costs.__getitem__)


def test_nothing_is_proposed_nearer_than_the_resolution_of_its_knobs(make_agent):
    agent = make_agent(KnobSpace([Knob("a", 0, 1, step=0.25), Knob("b", 0, 3, step=1)]), n_init=4, n_max=18)
    run(agent)
    steps = agent.samples / [0.25, 1.0]
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert len({tuple(row) for row in np.round(steps)}) == len(steps) == 18


@pytest.mark.parametrize("answer", [2, -2, "a", 0.5, True, np.nan, [1]])
def test_an_answer_that_is_none_of_the_four_is_refused(make_agent, answer):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    query = agent.ask()
    with pytest.raises(PreferenceError):
        agent.tell(query, answer)
    assert agent.ask() == query


def test_a_bare_number_an_enum_and_an_answer_mean_the_same(make_agent):
    agents = [make_agent(MIXED, n_init=3, n_max=6) for _ in range(3)]
    for agent, answer in zip(agents, (-1, Preference.CHALLENGER, Answer(-1)), strict=True):
        run(agent, [None, answer])
    assert agents[0].state == agents[1].state == agents[2].state


def test_the_incumbent_is_the_winner_along_the_answers(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    queries = run(agent, [None, 1, -1, 0, None, -1])
    assert [q.incumbent and q.incumbent.index for q in queries] == [None, 0, 0, 2, 2, 2]
    assert agent.ask().incumbent.index == agent.best_index == 5
    assert np.array_equal(agent.best, queries[5].challenger.theta)


def test_there_is_no_best_before_the_first_answer(make_agent):
    with pytest.raises(ProtocolError, match="before the first answer"):
        _ = make_agent(MIXED, n_init=3, n_max=6).best


def test_done_after_n_max_experiments_and_then_nothing_more_is_asked(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    queries = run(agent)
    assert [q.challenger.index for q in queries] == list(range(6))
    assert agent.done
    for call in (agent.ask, lambda: agent.tell(queries[-1], 0)):
        with pytest.raises(ProtocolError, match="6 experiments are answered"):
            call()


def test_abstaining_moves_on_and_keeps_the_incumbent(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=12)
    queries = run(agent, [None] * 12)
    assert agent.done
    assert {q.incumbent.index for q in queries[1:]} == {0}
    assert len({q.challenger for q in queries}) == 12


def test_where_the_constraints_allow_nothing_asking_says_so(make_agent):
    impossible = Constraint("never", lambda knobs: knobs["weight"] ** 2 + 1, vectorized=True)
    with pytest.raises(KnobError, match=r"no θ was found.*'never' is 1"):
        make_agent(KnobSpace(MIXED.knobs, [impossible]), n_init=3, n_max=6).ask()


def test_something_that_is_no_space_is_refused(make_agent):
    with pytest.raises(SettingsError, match="KnobSpace"):
        make_agent([(0, 1)])
