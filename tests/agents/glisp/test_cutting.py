"""Whether a run can still win, by what was learned from KPIs."""

import numpy as np
import pytest

from prefcal_agents import GLISp
from prefcal_agents.glisp.cutting import HOPELESS
from prefcal_env import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.loop import ask_and_tell

SPACE = KnobSpace([Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)])


def kpis(theta):
    return {"error": float(1.0 + 9.0 * (theta[0] - 0.3) ** 2), "effort": float(1.0 + theta[1])}


def told(experiments, *, cuts=()):
    """A study whose person looks at the error alone."""
    agent = GLISp(SPACE, n_init=6, n_max=30, seed=1)

    def answer(new, old):
        if old is None:
            return Answer(None, outcomes=(new, None))
        if agent.history.answered in cuts:
            mark = Mark.CHALLENGER_CUT_SHORT
            return Answer(1, marks=(mark,), outcomes=(new, old), automatic=(mark,))
        return Answer(int(np.sign(new["error"] - old["error"])), outcomes=(new, old))

    for _ in ask_and_tell(agent, kpis, answer):
        if agent.history.answered == experiments:
            return agent
    return agent


@pytest.fixture(scope="module")
def agent():
    return told(16)


def test_a_run_whose_error_is_large_already_cannot_win_and_others_can(agent):
    assert agent.chance_to_win({"error": 50.0, "effort": 1.0}) < HOPELESS
    assert agent.chance_to_win({"error": 0.0, "effort": 0.0}) == 1.0
    assert agent.chance_to_win({}) == 1.0


def test_the_chance_only_falls_as_bounds_grow(agent):
    chances = [agent.chance_to_win({"error": e, "effort": 1.5}) for e in np.linspace(0, 9, 30)]
    assert chances == sorted(chances, reverse=True)
    assert chances[0] > 0.5 > chances[-1]


def test_too_few_answers_say_nothing():
    assert told(9).chance_to_win({"error": 50.0}) == 1.0
    # Ten answers, four of which follow from cuts.
    assert told(11, cuts=(7, 8, 9, 10)).chance_to_win({"error": 50.0}) == 1.0


def test_runs_cut_short_are_not_compared_again():
    agent = told(16, cuts=(11, 12, 13))
    assert agent.history.cut_short() == {11, 12, 13}
    for _ in range(10):
        query = agent.ask()
        asked = {query.challenger.index, query.incumbent.index}
        assert not asked & agent.history.cut_short()
        agent.tell(query, Answer(1, outcomes=(kpis(query.challenger.theta), None)))


def test_an_agent_is_restored_as_it_was():
    agent = told(16, cuts=(11, 13))
    twin = GLISp.restore(SPACE, agent.state)
    bounds = {"error": 2.0, "effort": 1.2}
    assert twin.chance_to_win(bounds) == agent.chance_to_win(bounds)
    assert np.array_equal(twin.ask().challenger.theta, agent.ask().challenger.theta)
