"""More questions for each experiment: which are asked, and what they are worth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from prefcal_agents.placing import to_place

from prefcal_agents import GLISp, GLISpSettings, minimize_by_preference
from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.history.history import History
from prefcal_env.errors import ProtocolError, SettingsError
from prefcal_env.knobs.knob import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Preference
from support.studies import by, drive

SQUARE = KnobSpace([Knob("x", -1.0, 1.0), Knob("y", -1.0, 1.0)])


def bowl(theta):
    return float(np.sum((theta - 0.3) ** 2))


prefer = by(bowl)


def asking(questions, **counts):
    settings = GLISpSettings(questions_per_experiment=questions)
    return GLISp(SQUARE, settings=settings, **{"n_init": 4, "n_max": 12, **counts})


def run(agent, stop=None):
    return drive(agent, prefer, stop)


def ranked(costs):
    """A history of samples with these costs, each compared with the best before it."""
    book = History()
    for cost in costs:
        rival = book.incumbent
        answer = Answer(None if rival is None else int(np.sign(cost - costs[rival])))
        book = book.with_pending(np.array([cost])).told(answer, rival)
    return book


@given(st.lists(st.integers(0, 1000), min_size=3, max_size=40, unique=True))
def test_a_bisection_finds_the_place_of_a_loser_in_logarithmically_many_questions(costs):
    book, values = ranked([float(c) for c in costs]), np.array(costs, dtype=float)
    new = len(costs) - 1
    asked = 0
    while (pair := to_place(book, values)) is not None:
        assert pair[0] == new
        assert pair[1] != new
        book = book.told_further(Answer(int(np.sign(costs[new] - costs[pair[1]]))), *pair)
        asked += 1
    assert asked <= np.ceil(np.log2(len(costs)))
    if costs[new] > min(costs[:-1]):
        order = sorted(costs)
        known = {(c.challenger, c.incumbent): c.answer.preference for c in book.latest}
        above, below = order.index(costs[new]) - 1, order.index(costs[new]) + 1
        # Both neighbours were met, or he is at the end: nothing is left to be asked.
        assert (new, costs.index(order[above])) in known
        assert below == len(order) or (new, costs.index(order[below])) in known
    else:
        assert asked == 0


@pytest.mark.parametrize("answer", [0, None])
def test_a_tie_and_an_abstention_need_no_further_question(answer):
    book = ranked([1.0, 2.0, 3.0]).with_pending(np.array([2.5])).told(Answer(answer), 0)
    assert to_place(book, np.array([1.0, 2.0, 3.0, 2.5])) is None


def test_one_question_per_experiment_asks_nothing_further():
    assert not any(query.further for query in run(asking(1)))


@pytest.mark.parametrize("questions", [2, 3, 12])
def test_no_experiment_gets_more_questions_than_allowed(questions):
    asked = run(asking(questions))
    further = [query.challenger.index for query in asked if query.further]
    assert further
    assert max(further.count(index) for index in set(further)) <= questions - 1
    assert [q.challenger.index for q in asked if not q.further] == list(range(12))


def test_a_further_query_names_two_samples_that_are_closed():
    for query in run(asking(3)):
        if query.further:
            assert query.incumbent.index < query.challenger.index


def test_asking_twice_copying_and_restoring_change_nothing():
    agent = asking(3)
    while not agent.done:
        query = agent.ask()
        state = AgentState.from_dict(agent.state.to_dict())
        assert agent.ask() == agent.copy().ask() == GLISp.restore(SQUARE, state).ask() == query
        run(agent, 1)


def test_undo_takes_one_answer_back_whichever_it_is():
    agent = asking(3)
    asked = []
    while not agent.done:
        asked += run(agent, stop=1)
    assert any(query.further for query in asked)
    for query in reversed(asked):
        agent.undo()
        assert agent.ask() == query
    with pytest.raises(ProtocolError):
        agent.undo()


def test_a_further_answer_can_be_retracted_and_every_sample_stays():
    agent = asking(3)
    run(agent)
    samples, taught = agent.samples, len(agent.state.history.preferences())
    agent.retract(0, further=True)
    assert np.array_equal(agent.samples, samples)
    assert len(agent.state.history.preferences()) == taught - 1
    with pytest.raises(ProtocolError, match="retracted already"):
        agent.retract(0, further=True)
    with pytest.raises(ProtocolError, match="no answer 999"):
        agent.retract(999, further=True)


def test_what_a_state_says_of_further_answers_is_checked():
    agent = asking(3)
    run(agent, stop=9)
    plain = agent.state.to_dict()
    assert plain["further"]
    for change in ({"after": 99}, {"challenger": 50}, {"incumbent": None}):
        broken = {**plain, "further": [{**plain["further"][0], **change}]}
        with pytest.raises(SettingsError, match="further answer"):
            GLISp.restore(SQUARE, AgentState.from_dict(broken))


def test_lessons_come_in_the_order_answered():
    agent = asking(3)
    asked = [q for q in run(agent) if q.incumbent is not None]
    taught = agent.state.history.preferences()
    assert taught.first.tolist() == [q.challenger.index for q in asked]
    assert taught.second.tolist() == [q.incumbent.index for q in asked]


def test_samples_are_listed_once_each_whatever_is_asked():
    def make(space, **counts):
        return GLISp(space, settings=GLISpSettings(questions_per_experiment=3), **counts)

    found = minimize_by_preference(prefer, SQUARE, agent=make, n_max=12)
    assert len(found.samples) == 12
    assert len(found.answers) > 11


def test_zero_questions_are_refused():
    with pytest.raises(SettingsError, match="questions_per_experiment"):
        GLISpSettings(questions_per_experiment=0)


def until_further(agent):
    while not (query := agent.ask()).further:
        run(agent, 1)
    return query


def test_the_number_can_be_raised_and_lowered_while_it_runs():
    agent = asking(1)
    run(agent, 6)
    query = agent.ask()  # its experiment may have run by now
    more = agent.with_questions(3)
    assert (more.ask(), more.ask().further) == (query, False)
    further = until_further(more)
    fewer = more.with_questions(1)
    assert not fewer.ask().further
    assert fewer.ask().challenger.index == further.challenger.index + 1
    assert fewer.with_questions(3).ask() == fewer.ask()  # that sample is stored by now
    assert more.with_questions(12).ask() == further
    assert [a.settings.questions_per_experiment for a in (agent, more, fewer)] == [1, 3, 1]


def test_an_answer_to_a_further_query_stays_when_the_number_is_lowered():
    agent = asking(3)
    until_further(agent)
    run(agent, 1)
    before = agent.state.history
    fewer = agent.with_questions(1)
    assert fewer.state.history.further == before.further != ()
    fewer.undo()
    assert fewer.state.history.further == before.further[:-1]
    assert not fewer.ask().further


def test_a_changed_agent_is_restored_with_the_identical_query():
    agent = asking(1)
    run(agent, 6)
    agent = agent.with_questions(3)
    while not agent.done:
        twin = GLISp.restore(SQUARE, AgentState.from_dict(agent.state.to_dict()))
        assert twin.ask() == agent.ask()
        run(agent, 1)
    assert agent.state.history.further


@pytest.mark.parametrize("most", [0, -1, 1.5, True, None])
def test_an_impossible_number_is_refused_and_changes_nothing(most):
    agent = asking(2)
    with pytest.raises(SettingsError, match="questions_per_experiment"):
        agent.with_questions(most)
    assert agent.settings.questions_per_experiment == 2


def agreement(questions, seed, **settings):
    """How well Ĵ ranks the samples of a study."""
    settings = GLISpSettings(questions_per_experiment=questions, **settings)
    agent = GLISp(SQUARE, settings=settings, n_init=8, n_max=12, seed=seed)
    run(agent)
    found = np.argsort(np.argsort(agent.surrogate(agent.samples)))
    true = np.argsort(np.argsort([bowl(t) for t in agent.samples]))
    return np.corrcoef(found, true)[0, 1]


def test_further_answers_teach_the_order():
    assert min(agreement(12, seed, validate_at=()) for seed in range(3)) > 0.99


@pytest.mark.campaign
def test_with_further_answers_the_samples_are_ranked_better():
    """Not always perfectly: a very wide φ does not keep all answers about samples that are close.

    docs/research/questions.md has it among what is open.
    """
    many, one = ([agreement(questions, seed) for seed in range(5)] for questions in (12, 1))
    assert np.median(many) > 0.99
    assert min(many) > 0.94
    assert np.mean(many) > np.mean(one)


def test_the_winner_stays_the_winner_along_the_first_answers():
    agent = asking(12)
    run(agent)
    costs = [bowl(theta) for theta in agent.samples]
    assert np.array_equal(agent.best, agent.samples[int(np.argmin(costs))])
    assert Preference.INCUMBENT in {c.answer.preference for c in agent.state.history.further}
