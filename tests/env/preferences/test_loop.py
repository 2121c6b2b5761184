"""One loop serves every kind of agent: what is run, compared and told is the caller's."""

import numpy as np

from prefcal_agents import GLIS, GLISp, GLISpSettings, RandomSearch
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.loop import ask_and_tell

SPACE = KnobSpace([Knob("gain", 0.0, 1.0)])


def cost(theta):
    return float((theta[0] - 0.3) ** 2)


def better(new, old):
    return None if old is None else int(np.sign(new - old))


def test_results_need_not_be_experiments():
    agent = RandomSearch(SPACE, n_init=2, n_max=6, seed=0)
    steps = list(ask_and_tell(agent, cost, better))
    assert [step.challenger for step in steps] == [cost(theta) for theta in agent.samples]
    assert cost(agent.best) == min(step.challenger for step in steps)
    assert (steps[0].incumbent, steps[0].answer) == (None, None)


def test_an_agent_that_learns_from_scores_is_told_them():
    agent = GLIS(SPACE, n_init=3, n_max=5, seed=0)
    steps = list(ask_and_tell(agent, cost, lambda new, _: new))
    assert [step.answer for step in steps] == [cost(theta) for theta in agent.samples]
    assert all(step.incumbent is None for step in steps)


def test_every_experiment_runs_once_even_if_it_is_asked_about_again():
    ran = []

    def run(theta):
        ran.append(float(theta[0]))
        return cost(theta)

    settings = GLISpSettings(questions_per_experiment=3)
    agent = GLISp(SPACE, n_init=3, n_max=6, seed=0, settings=settings)
    assert len(list(ask_and_tell(agent, run, better))) > len(ran) == 6


def test_the_loop_stops_between_two_answers():
    agent = RandomSearch(SPACE, n_init=2, n_max=6, seed=0)
    told = ask_and_tell(agent, cost, lambda new, old: Answer(better(new, old)))
    next(told), next(told)
    assert agent.state.history.answered == 2
