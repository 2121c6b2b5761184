"""What a study says that a person can do now is what it takes, and everything else is refused."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.session import Choice
from prefcal_app.session.actions import ACTIONS
from prefcal_env.errors import ScenarioError, SettingsError, StaleError
from prefcal_env.preferences.answer import Answer
from prefcal_env.sources.rig import Rig
from support.interviews import THREE, begin, proceed
from toy_scenario_tools import CHANNELS, csv
from toy_study import toy_scenario

TOY = toy_scenario()
RIG = replace(TOY, cost=None, references={}, kpis=(), run=Rig(CHANNELS, (2.0,)))


def arguments(interview, rng):
    """Arguments of each step as a page would send them now."""
    now = interview.now()
    question = 0 if now.question is None else now.question.id
    index = 0 if now.pending is None else now.pending.index
    theta = interview.scenario.space.decode(rng.random(len(interview.scenario.space)))
    standing = [i for i, c in enumerate(now.state.history.comparisons) if i and not c.retracted]
    return {
        "answer": (question, rng.choice([*Choice])),
        "give": (question, Answer(None)),
        "mark": (question, "left", "unsafe", True),
        "undo": (now.version,),
        "retract": (standing[-1] if standing else None,),
        "repeat": (),
        "pace": (int(rng.integers(1, 4)),),
        "ask_for": (theta,),
        "choose": (theta, now.incumbent),
        "keep_on_plant": (int(rng.choice([0, now.incumbent or 0])), now.incumbent),
        "try_on_plant": (now.incumbent, None),
        "end_trial": (),
        "record": (index, csv(5 + 5 * rng.random()), False, None, True),
        "write_and_start": (index,),
        "stop_run": (index,),
        "fail": (index, "it broke"),
        "retry": (),
        "finish": (),
        "go_on": (2,),
    }


@pytest.mark.parametrize("scenario", [TOY, RIG], ids=["simulated", "rig"])
@pytest.mark.parametrize("seed", range(3))
def test_a_random_walk_takes_what_is_offered_and_nothing_else(scenario, seed):
    rng = np.random.default_rng(seed)
    interview = begin(scenario, n_max=8, agent=THREE)
    taken = set()
    for _ in range(60):
        now = proceed(interview)
        given = arguments(interview, rng)
        for step in set(ACTIONS) - now.can:
            with pytest.raises((StaleError, ScenarioError, SettingsError)):
                interview.do(ACTIONS[step](*given[step]))
        assert interview.now().version == now.version, "what is refused changes nothing"
        offered = sorted(now.can - ({"retract"} if given["retract"] == (None,) else set()))
        if now.state.history.answered >= 7:  # no further θ fits
            offered.remove("ask_for") if "ask_for" in offered else None
        step = str(rng.choice(offered))
        interview.do(ACTIONS[step](*given[step]))
        taken.add(step)
    assert len(taken) >= 7
