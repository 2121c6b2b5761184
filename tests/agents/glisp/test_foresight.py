"""What is said of the next experiment: what it follows from, and when nothing is said."""

from itertools import pairwise

import numpy as np
import pytest

from prefcal_agents import GLISp, GLISpSettings, restore
from prefcal_agents.glisp.agent import FROM, Foresight, lost_since
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History

SQUARE = KnobSpace([Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)])
BEST = np.array([0.7, 0.4])
WON, SAME, LOST = -1, 0, 1
"""What the challenger did."""


def kpis(theta):
    """Two KPIs that the person weighs alike."""
    return {"near": abs(theta[0] - BEST[0]), "low": abs(theta[1] - BEST[1])}


def missed(theta):
    return sum(kpis(theta).values())


def answer(agent, cost=missed, told=kpis):
    """Answer the open query as someone does who wants a small cost."""
    query = agent.ask()
    new, old = (None if s is None else np.array(s.theta) for s in (query.challenger, query.incumbent))
    verdict = None if old is None else int(np.sign(cost(new) - cost(old)))
    outcomes = tuple(None if theta is None else told(theta) for theta in (new, old))
    agent.tell(query, Answer(verdict, outcomes=outcomes if outcomes[0] else None))
    return query


def agent_after(answers, n_max=20, **settings):
    """An agent with an open query after so many answers."""
    agent = GLISp(SQUARE, n_init=4, n_max=n_max, settings=GLISpSettings(**settings))
    while len(agent.history.lessons()) < answers:
        answer(agent)
    if not agent.done:
        agent.ask()
    return agent


@pytest.fixture(scope="module")
def known():
    return agent_after(10)


def test_the_chance_falls_with_every_answer_since_a_challenger_won():
    chances = [Foresight(0.4, lost).chance for lost in range(12)]
    assert all(later < earlier for earlier, later in pairwise(chances))
    assert 0 < chances[-1] < chances[0] < 1


def test_the_chance_follows_the_draws_but_is_never_as_sure_as_they_are():
    chances = [Foresight(share, 2).chance for share in (0.0, 0.1, 0.5, 0.9, 1.0)]
    assert all(earlier < later for earlier, later in pairwise(chances))
    assert chances[0] > 0
    assert chances[-1] < 0.99


def test_only_answers_in_which_the_challenger_lost_count_since_it_last_won():
    def record(*answers):
        answered = [Comparison(k + 1, k, Answer.of(each)) for k, each in enumerate(answers)]
        return History((), (Comparison(0, None, Answer(None)), *answered))

    assert lost_since(record(LOST, SAME, LOST)) == 3
    assert lost_since(record(LOST, WON, LOST, None, SAME)) == 2  # None teaches nothing
    assert lost_since(record(LOST, WON)) == 0


def test_a_theta_beyond_the_best_promises_more_than_one_that_falls_back():
    start = [np.array([a, 0.5]) for a in (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)]  # each is better than the last

    def promised(theta):
        agent = GLISp(SQUARE, n_init=6, n_max=20, start=start)
        for _ in start:
            answer(agent, lambda theta: theta[0], lambda theta: {"a": theta[0], "b": theta[1]})
        agent.replace_pending(np.array(theta))
        return agent.foresight.better

    assert promised([0.2, 0.5]) > 0.6 > 0.2 > promised([0.75, 0.5])


def test_looking_at_it_changes_no_proposal_and_a_restart_not_what_is_said(known):
    watched, alone = (GLISp(SQUARE, n_init=4, n_max=12) for _ in range(2))
    while not alone.done:
        _ = watched.foresight
        assert answer(watched).challenger == answer(alone).challenger
    assert known.foresight is not None
    assert restore(SQUARE, known.state).foresight == known.foresight


def test_nothing_is_said_before_the_fifth_answer_without_kpis_and_between_known_experiments():
    assert agent_after(FROM - 1).foresight is None
    assert agent_after(FROM).foresight is not None
    assert agent_after(FROM, kpis=False).foresight is None
    agent = agent_after(FROM, questions_per_experiment=3)
    while not agent.ask().further:
        answer(agent)
    assert agent.foresight is None


def test_after_the_last_answer_it_is_about_one_more_experiment():
    ended, open_ = agent_after(6, n_max=7), agent_after(6)
    assert ended.done
    assert not ended.foresees  # one more has to be proposed for it
    assert ended.foresight == open_.foresight
    assert ended.foresees


def test_it_is_known_at_once_with_the_query_but_not_after_a_restart(known):
    assert known.foresees
    again = restore(SQUARE, known.state)
    assert not again.foresees
    _ = again.foresight
    assert again.foresees


def test_where_every_value_was_tried_no_experiment_is_left_to_foresee():
    few = KnobSpace([Knob("a", 0, 6, integer=True)])
    agent = GLISp(few, n_init=3, n_max=20)
    while not agent.done:
        answer(agent, lambda theta: theta[0], lambda theta: {"near": theta[0]})
    assert len(agent.history.lessons()) >= FROM
    assert agent.foresight is None


def test_no_number_is_stated_where_kpis_do_not_explain_the_answers():
    rng = np.random.default_rng(0)
    agent = GLISp(SQUARE, n_init=10, n_max=26)
    while not agent.done:
        answer(agent, told=lambda theta: {"noise": float(rng.random())})
    assert agent.foresight.better is None
    assert agent.foresight.chance is None
