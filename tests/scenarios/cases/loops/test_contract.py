"""The named closed loops keep the contract, and show what a person needs."""

import numpy as np
import pytest

from contracts.loops import *  # noqa: F403
from prefcal_app.session import Choice, actions
from prefcal_app.view import now_view
from prefcal_scenarios.cases.loops import LOOPS, named
from prefcal_scenarios.names import CLOSED_LOOPS, is_built_in
from prefcal_scenarios.scenario import panels_of
from support.interviews import begin, proceed


@pytest.fixture(params=LOOPS)
def name(request):
    return request.param


@pytest.fixture
def make(name):
    return LOOPS[name]


def test_the_names_are_those_of_the_loops():
    assert tuple(LOOPS) == CLOSED_LOOPS


@pytest.mark.parametrize("name", ["loop", "loop-", "loop--1", "loop-1.5", "loop-²", "Servo"])
def test_other_names_are_not_built_in(name):
    assert not is_built_in(name)


@pytest.mark.parametrize("name", ["servo", "mpc-oscillatory"])
def test_people_compare_its_experiments_in_the_window(name):
    interview = begin(named(name), n_max=3)
    for _ in range(2):
        question = proceed(interview).question
        view = now_view(interview)["question"]
        for side in ("left", "right"):
            assert len(view[side]["curves"]) == len(view["panels"]) == len(named(name).panels)
        interview.do(actions.Answer(question.id, Choice.LEFT))
    assert proceed(interview).question is None


def test_limits_far_from_the_step_are_not_drawn_and_saturation_is():
    servo, tank = (panels_of(named(n), named(n).run(middle(n))) for n in ("servo", "tank"))
    assert (servo[0].channel.low, servo[0].channel.high) == (-np.inf, np.inf)
    assert (servo[1].channel.low, servo[1].channel.high) == (-2.0, 2.0)
    assert (tank[0].channel.low, tank[0].channel.high) == (0.0, 1.0)


def middle(name):
    space = LOOPS[name]().space
    return space.decode(np.full(len(space), 0.5))
