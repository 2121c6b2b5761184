"""Answers that contradict each other are noticed, and need not all be kept then."""

import numpy as np
import pytest
from prefcal_agents.softness import advantage, contradictory

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.fitting import Learning
from prefcal_agents.ledger import Preferences
from prefcal_agents.surrogate import Shape
from prefcal_env.errors import SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.qp import make_backend

SQUARE = KnobSpace([Knob("x", -1.0, 1.0), Knob("y", -1.0, 1.0)])


def compared(share, seed):
    """60 comparisons of 30 samples of a bowl, that share of them the wrong way round."""
    rng = np.random.default_rng(seed)
    samples = rng.random((30, 2))
    cost = np.sum((samples - 0.4) ** 2, axis=1)
    pairs = np.array([rng.choice(30, 2, replace=False) for _ in range(60)])
    b = np.sign(cost[pairs[:, 0]] - cost[pairs[:, 1]]).astype(np.int64)
    wrong = rng.permutation(60) < share * 60
    b = np.where(wrong, -b, b)
    return Preferences(samples, pairs[:, 0], pairs[:, 1], b, np.ones(60))


def found(share):
    learning = Learning(margin_power=1.0)
    return [
        advantage(
            compared(share, seed), Shape(1.0, (1.0, 1.0)), learning, 1e5, make_backend("piqp"), 3,
            (seed, 30),
        )
        for seed in range(6)
    ]  # fmt: skip


def test_mistakes_are_noticed_and_consistent_answers_are_not_taken_for_mistakes():
    right, wrong = found(0.0), found(0.2)
    assert not contradictory(right)
    assert contradictory(wrong)
    assert np.mean(wrong) > np.mean(right) + 2


@pytest.mark.parametrize(
    ("advantages", "expected"),
    [([], False), ([0], False), ([1], True), ([1, 0, 0], False), ([5, -1, -1, 0], True)],
)
def test_the_evidence_of_several_proposals_is_added_up(advantages, expected):
    assert contradictory(advantages) is expected


def told(settings, flips):
    agent = GLISp(SQUARE, n_init=6, n_max=16, settings=settings)
    while not agent.done:
        query = agent.ask()
        answer = None
        if query.incumbent is not None:
            costs = [
                float(np.sum((s.theta - 0.2) ** 2)) for s in (query.challenger, query.incumbent)
            ]
            answer = int(np.sign(costs[0] - costs[1])) * (
                -1 if query.challenger.index in flips else 1
            )
        agent.tell(query, answer)
    return agent


def test_softening_can_be_switched_off_and_then_nothing_is_weighed():
    agent = told(GLISpSettings(soften=1.0), {8, 12})
    assert not agent._learner.evidence
    assert told(GLISpSettings(), {8, 12})._learner.evidence


def test_a_restored_agent_weighs_the_same_evidence():
    agent = told(GLISpSettings(), {7, 9, 12})
    agent.undo()
    cold = GLISp.restore(SQUARE, agent.state)
    assert cold.ask() == agent.ask()
    cold.tell(cold.ask(), 1)
    agent.tell(agent.ask(), 1)
    assert cold.state == agent.state


def test_softening_below_one_is_refused():
    with pytest.raises(SettingsError, match="soften"):
        GLISpSettings(soften=0.5)
