"""Answers that contradict each other are noticed, and looked into."""

from dataclasses import replace

import numpy as np
import pytest
from prefcal_agents.doubt import Doubts, contenders

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.history.history import History
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.best import contradictory
from support.studies import by, drive

SQUARE = KnobSpace([Knob("x", -1.0, 1.0, step=0), Knob("y", -1.0, 1.0, step=0)])


def bowl(theta):
    return float(np.sum((theta - 0.2) ** 2))


def told(settings, flips, *, space=SQUARE, cost=bowl, n_init=6, n_max=16, seed=0):
    """A study in which the answers about the experiments of `flips` are wrong."""
    agent = GLISp(space, n_init=n_init, n_max=n_max, settings=settings, seed=seed)
    drive(agent, by(cost), wrong=lambda query: query.challenger.index in flips)
    return agent


def ledger_of(flips, seed=0):
    """30 random samples of a bowl, each compared with an earlier one."""
    rng = np.random.default_rng(seed)
    history, costs = History(), []
    for k, z in enumerate(rng.random((30, 2))):
        costs.append(float(np.sum((z - 0.4) ** 2)))
        rival = int(rng.integers(k)) if k else None
        answer = None if rival is None else int(np.sign(costs[k] - costs[rival]))
        history = history.with_pending(z).told(Answer.of(-answer if k in flips else answer), rival)
    return history


def evidence(flips, seed):
    doubt = Doubts(SQUARE, "inverse_quadratic", 30, 0.1).after(ledger_of(flips, seed), no_kpis)
    return doubt.evidence, doubt.justified


def no_kpis(history):
    return None


def test_mistakes_are_noticed_and_consistent_answers_are_not_taken_for_mistakes():
    right = [evidence(set(), seed) for seed in range(4)]
    wrong = [evidence({5, 11, 16, 20, 27}, seed) for seed in range(6)]
    assert not any(justified for _, justified in right)
    assert sum(justified for _, justified in wrong) >= 4


def test_a_person_who_never_errs_gets_the_last_winner_and_what_he_got_without_doubts():
    with_doubts, without = (
        told(GLISpSettings(error_rate=rate), set(), n_max=18) for rate in (0.1, 0.0)
    )
    assert with_doubts.state.history == without.state.history
    assert with_doubts.best_index == with_doubts.state.history.incumbent


@pytest.mark.campaign
def test_with_four_wrong_answers_the_gap_is_smaller_than_if_all_were_kept():
    flips = {12, 16, 20, 25}
    ratios = []
    for seed in range(8):  # in five of these the mistakes are noticed
        gaps = [
            bowl(told(GLISpSettings(error_rate=rate), flips, n_max=36, seed=seed).best)
            for rate in (0.1, 0.0)
        ]
        ratios.append(np.log10(gaps[0] / gaps[1]))
    assert np.mean(ratios) < -0.3


@pytest.fixture(scope="module")
def suspected():
    """A study in which mistakes are suspected, and after which experiment more was asked."""
    agent, asked = GLISp(SQUARE, n_init=6, n_max=40, seed=0), []
    while not agent.done:
        best, answered = agent.best_index if len(agent.samples) else None, len(agent.samples)
        (query,) = drive(agent, by(bowl), 1, wrong=mistaken)
        assert best is None or best in (query.challenger.index, query.incumbent.index)
        if query.further and answered < agent.n_max:  # then former bests follow
            asked.append(answered)
    return agent, asked


def mistaken(query):
    return query.challenger.index in {7, 12, 16, 21, 27} and not query.further


def test_a_suspicion_leads_to_a_question_about_the_best_at_most_once_an_experiment(suspected):
    agent, asked = suspected
    assert asked
    assert len(asked) == len(set(asked))
    assert agent.best_index == agent.state.history.incumbent


def test_only_answers_that_contradict_each_other_are_taken_for_mistakes(suspected):
    """However little the surrogate expects them: a cost that jumps looks like mistakes, too."""
    agent, _ = suspected
    history = agent.state.history
    in_a_line = replace(history, further=())
    assert contradictory(history.verdicts())
    assert not contradictory(in_a_line.verdicts())
    assert reckons_with_mistakes(history)
    assert not reckons_with_mistakes(in_a_line)


def reckons_with_mistakes(history):
    """Whether the error rate makes a difference to what is learned."""
    learned = []
    for rate in (0.1, 0.0):
        settings = GLISpSettings(error_rate=rate, validate_at=(10,))
        fresh = GLISp(SQUARE, n_init=6, n_max=40, settings=settings)
        agent = GLISp.restore(SQUARE, replace(fresh.state, history=history))
        learned.append(agent.surrogate(agent.samples))
    return not np.array_equal(*learned)


def test_what_was_not_compared_or_is_unsafe_is_no_contender():
    history = History()
    answers = (None, -1, -1, None, Answer(1, marks=(Mark.INCUMBENT_UNSAFE,)))
    for k, answer in enumerate(answers):
        history = history.with_pending(np.full(2, k / 5))
        history = history.told(Answer.of(answer), None if k == 0 else min(k - 1, 2))
    assert contenders(history).tolist() == [0, 1, 4]


@pytest.mark.parametrize("questions", [1, 3])
def test_a_restored_agent_doubts_the_same(questions):
    agent = told(GLISpSettings(questions_per_experiment=questions), {7, 9, 12})
    agent.undo()
    cold = GLISp.restore(SQUARE, agent.state)
    assert cold.ask() == agent.ask()
    cold.tell(cold.ask(), 1)
    agent.tell(agent.ask(), 1)
    assert cold.state == agent.state
    assert cold.best_index == agent.best_index == agent.copy().best_index


@pytest.mark.parametrize("rate", [-0.1, 0.5, np.nan])
def test_an_impossible_error_rate_is_refused(rate):
    with pytest.raises(SettingsError, match="error_rate"):
        GLISpSettings(error_rate=rate)
