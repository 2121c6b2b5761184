"""A source that nobody wrote prefcal for is asked about, run and compared like any other."""

import numpy as np
import pytest

from prefcal_app.session import Choice, Phase, actions
from prefcal_app.view import now_view
from prefcal_env.errors import ScenarioError, StaleError
from prefcal_env.sources import Run
from prefcal_scenarios.scenario import KPI, Scenario
from support.device import SPACE, Device
from support.interviews import begin, worked

SCENARIO = Scenario("device", "A device", SPACE, Device())


def confirmed(interview):
    while (now := interview.now()).phase is Phase.CONFIRM:
        interview.do(actions.WriteAndStart(now.pending.index))
        assert interview.work()
    return interview.now()


def test_each_run_is_confirmed_and_compared():
    interview = begin(SCENARIO, n_max=3)
    with pytest.raises(StaleError, match="is not running"):
        interview.do(actions.StopRun(0))
    view = now_view(interview)
    assert view["live"]["changes"][0]["old"] == "unknown"
    assert view["live"]["instructions"] == "Is the tank closed?"
    assert view["live"]["duration"] is None
    assert not view["live"]["stops"]
    for _ in range(2):
        question = confirmed(interview).question
        assert question.left.experiment.kpis["integrated error of level"] > 0
        interview.do(actions.Answer(question.id, Choice.LEFT))
        worked(interview)
    assert interview.now().phase is Phase.OVER


def test_a_run_that_cannot_be_stopped_says_so():
    interview = begin(SCENARIO)
    interview.do(actions.WriteAndStart(0))
    with pytest.raises(ScenarioError, match="cannot be stopped from here"):
        interview.do(actions.StopRun(0))
    assert interview.work()


def test_a_formula_reads_the_signals_of_a_device():
    peak = KPI("peak", "peak", "m", formula="max(level) - ref(level)")
    interview = begin(Scenario("device", "A device", SPACE, Device(), kpis=(peak,)), n_max=3)
    assert confirmed(interview).question.left.experiment.kpis["peak"] < 0


def test_old_values_that_were_not_restored_are_tried_again_and_nothing_runs_before():
    class Cut(Run):
        tries = 0

        def advance(self):
            Cut.tries += 1
            if Cut.tries == 1:
                raise OSError("the line is cut")

    class Unrestored(Device):
        recovers = True

        def recovery(self):
            return Cut()

    interview = begin(Scenario("device", "A device", SPACE, Unrestored()))
    with pytest.raises(StaleError, match="not known yet"):
        interview.do(actions.WriteAndStart(0))
    assert interview.work()
    with pytest.raises(StaleError, match="old values"):
        interview.do(actions.WriteAndStart(0))
    for _ in range(2):  # the second time by somebody who wants to be sure
        interview.do(actions.Retry())
        assert interview.work()
    assert Cut.tries == 3
    assert interview.do(actions.WriteAndStart(0)).phase is Phase.RUNNING


def test_nothing_runs_on_it_unseen():
    with pytest.raises(ScenarioError, match="simulated must be False"):
        Scenario("device", "A device", SPACE, Device(), simulated=True)
    with pytest.raises(ScenarioError, match="a person confirms each run"):
        SCENARIO.run(np.array([1.0, 2.0]))
