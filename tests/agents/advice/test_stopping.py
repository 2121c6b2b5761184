"""Stopping advice: counted by hand, and asked of every agent."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import betabinom

from contracts.agents import MIXED, judge, run
from prefcal_agents import GLIS, Advice, GLISp, RandomSearch
from prefcal_agents.advice.stopping import advise
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube


def told(*preferences):
    """A history in which these were answered, after the first experiment's None."""
    history = History()
    for preference in (None, *preferences):
        history = history.with_pending(in_cube([0.5])).with_answer(
            Answer(preference), history.incumbent
        )
    return history


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


def test_the_number_of_improvements_is_beta_binomial():
    advice, weights = advise(told(*[1] * 4, -1)), [0.5 ** (age / 7) for age in range(5)]
    number = betabinom(10, 0.2 + weights[0], 0.8 + sum(weights[1:]))
    assert advice.none == pytest.approx(number.pmf(0))
    assert (advice.low, advice.high) == (number.ppf(0.1), number.ppf(0.9))


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
    assert ties.stop


def test_a_retracted_answer_counts_as_nothing():
    history = told(*[1] * 6, -1)
    assert advise(history.retracted(7)) == advise(told(*[1] * 6))


@pytest.mark.parametrize(
    ("none", "expected", "sentence"),
    [
        (0.18, 2.14, "Another 10 experiments are likely to bring a better one: about 2 would beat "
         "the best, none with a chance of 18 % (3 of the last 10 beat the best before)."),
        (0.5, 0.7, "Another 10 experiments may bring a better one: about 1 would beat the best, "
         "none with a chance of 50 % (3 of the last 10 beat the best before)."),
        (0.82, 0.2, "It is a good time to stop: with a chance of 82 %, another 10 experiments "
         "would bring nothing better (3 of the last 10 beat the best before)."),
    ],
)  # fmt: skip
def test_one_sentence_says_whether_to_go_on_and_holds_the_numbers(none, expected, sentence):
    advice = Advice(10, 3, expected, 0, 4, none)
    assert advice.text == sentence
    assert advice.stop == (none > 0.75)


@given(st.lists(st.sampled_from([-1, 0, 1, None]), max_size=30))
def test_whatever_is_answered_the_advice_is_sound(preferences):
    advice = advise(told(*preferences))
    if advice is None:
        return
    assert 0 < advice.expected < 10
    assert 0 <= advice.low <= advice.high <= 10
    assert 0 < advice.none < 1
    assert advice.improved <= advice.recent <= 10


def test_the_advice_of_an_agent_changes_nothing():
    learned, blind = GLISp(MIXED, n_init=3, n_max=9), RandomSearch(MIXED, n_init=3, n_max=9)
    assert learned.advice is None
    for agent in (learned, blind):
        run(agent, [judge] * 7)
    before = learned.state
    assert learned.advice == learned.advice
    assert blind.advice is not None
    assert learned.state == before


def test_an_agent_that_sees_scores_counts_new_lowest_ones():
    agent = GLIS(MIXED, n_init=3, n_max=9)
    for score in (5.0, 4.0, 4.5, 4.0, 3.0, 7.0):
        agent.tell(agent.ask(), score)
    assert (agent.advice.recent, agent.advice.improved) == (5, 2)
