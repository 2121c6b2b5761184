"""Stopping advice: counted by hand, and asked of every agent."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contracts.agents import MIXED, judge, run
from prefcal_agents import GLIS, Advice, GLISp, RandomSearch
from prefcal_agents.ledger import Ledger
from prefcal_agents.stopping import advise
from prefcal_env.preference import Answer


def told(*preferences):
    """A ledger in which these were answered, after the first experiment's None."""
    ledger = Ledger()
    for preference in (None, *preferences):
        ledger = ledger.with_pending([0.5]).told(Answer(preference), ledger.incumbent)
    return ledger


def test_nothing_is_said_of_a_few_verdicts():
    assert advise(told(-1, 1, 0, -1)) is None
    assert advise(told(-1, 1, 0, -1, None, None)) is None
    assert advise(told(-1, 1, 0, -1, 1)) is not None


def test_the_rate_is_counted_by_hand():
    advice = advise(told(*[1] * 4, -1))
    weights = [0.5 ** (age / 7) for age in range(5)]
    won, lost = 0.2 + weights[0], 0.8 + sum(weights[1:])
    assert advice.expected == pytest.approx(10 * won / (won + lost))
    assert (advice.recent, advice.improved) == (5, 1)


def test_only_the_last_ten_are_told_of():
    advice = advise(told(*[-1] * 6, *[1] * 10))
    assert (advice.recent, advice.improved) == (10, 0)


def test_recent_improvements_count_more():
    early, late = advise(told(*[-1] * 5, *[1] * 10)), advise(told(*[1] * 10, *[-1] * 5))
    assert late.expected > 2 * early.expected


def test_ties_say_that_there_is_little_left():
    lost, ties = advise(told(-1, *[1] * 9)), advise(told(-1, *[0] * 9))
    assert ties.expected < lost.expected / 2
    assert ties.none > 0.75
    assert ties.text.endswith("A good time to stop.")


def test_a_retracted_answer_counts_as_nothing():
    ledger = told(*[1] * 6, -1)
    assert advise(ledger.retracted(7)) == advise(told(*[1] * 6))


def test_the_sentences_hold_the_numbers():
    advice = Advice(10, 3, 2.14, 0, 4, 0.18, 0.0213)
    assert advice.text == (
        "3 of the last 10 experiments beat the best so far. Of another 10, about 2.1 would be "
        "expected to (80 %: 0 to 4; none with a chance of 18 %). The learned cost at its lowest is "
        "2.1 % of its range below the best. Going on is likely to pay."
    )
    assert "less than 0.1 %" in Advice(10, 3, 2.1, 0, 4, 0.18, 0.0).text


@given(st.lists(st.sampled_from([-1, 0, 1, None]), max_size=30))
def test_whatever_is_answered_the_advice_is_sound(preferences):
    advice = advise(told(*preferences))
    if advice is None:
        return
    assert 0 < advice.expected < 10
    assert 0 <= advice.low <= advice.high <= 10
    assert 0 < advice.none < 1
    assert advice.improved <= advice.recent <= 10


def test_glisp_promises_and_random_search_does_not():
    learned, blind = GLISp(MIXED, n_init=3, n_max=9), RandomSearch(MIXED, n_init=3, n_max=9)
    assert learned.advice is None
    for agent in (learned, blind):
        run(agent, [judge] * 7)
    assert learned.advice.promise >= 0
    assert blind.advice.promise is None
    before = learned.state
    assert learned.advice == learned.advice
    assert learned.state == before


def test_an_agent_that_sees_scores_counts_new_lowest_ones():
    agent = GLIS(MIXED, n_init=3, n_max=9)
    for score in (5.0, 4.0, 4.5, 4.0, 3.0, 7.0):
        agent.tell(agent.ask(), score)
    assert (agent.advice.recent, agent.advice.improved) == (5, 2)
