"""Runs of an own scenario that never return, in an interview: stopped, counted as failed, gone on.

The scenario hangs where the gain is above 40; what it does else is the toy's.
"""

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from prefcal_agents import RandomSearch
from prefcal_app.session import Background, Choice, Phase, actions, unattended
from prefcal_app.view import now_view
from prefcal_env.errors import RunError, StaleError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import isolation
from support.interviews import begin, until, worked
from support.wild_runs import GAIN

BAD = (0.31, 26.0, 50.0)
HANGS = str(Path(__file__).parents[2] / "support" / "wild_runs.py") + ":hangs"


@contextmanager
def hanging(limit=60.0, **options):
    """An interview about it; with seed 9 the third run of GLISp hangs."""
    with isolation(HANGS, limit) as isolated:
        yield begin(isolated(load(HANGS)), **options)


def hangs(now):
    return now.phase is Phase.RUNNING and now.pending is not None and now.pending.theta[2] > GAIN


def settled(now):
    return now.phase is not Phase.RUNNING


def answer_until_it_hangs(interview):
    while not hangs(now := until(interview, lambda now: settled(now) or hangs(now))):
        assert now.phase is Phase.QUESTION, now.problem
        interview.do(actions.Answer(now.question.id, Choice.LEFT))
    return now


@pytest.mark.parametrize("ahead", [False, True], ids=["when due", "ahead"])
def test_a_run_that_hangs_is_stopped_counted_as_failed_and_the_study_goes_on(ahead):
    with hanging(n_max=8, seed=9, ahead=ahead) as interview, Background(interview):
        now = answer_until_it_hangs(interview)
        assert now.run_limit == 60.0
        assert now_view(interview)["stopping"].startswith("A run is stopped after 1 min (")
        index = now.pending.index
        with pytest.raises(StaleError):
            interview.do(actions.StopRun(index + 1))
        interview.do(actions.StopRun(index))
        now = until(interview, settled)
        assert now.phase is Phase.FAILED
        assert "you stopped the run" in now.problem
        assert now.state.failures[index] == now.problem
        interview.do(actions.Fail(index, now.problem))
        now = until(interview, settled)
        assert interview.past.experiment(index).end is End.FAILED
        assert now.phase is Phase.QUESTION


def on_suspicion(interview):
    """Have the interview run ahead what hangs, when all else is run ahead."""
    worked(interview)
    interview._driver.thoughts.prefetch.next = BAD
    interview._idle_at = None


def test_a_run_on_suspicion_that_hangs_makes_way():
    with hanging(n_max=8, seed=1, ahead=True) as interview:
        on_suspicion(interview)
        with Background(interview):
            now = until(interview, lambda now: BAD in interview._driver.underway.going)
            interview.do(actions.Mark(now.question.id, "left", "unsafe", True))  # foreseen answers are void
            interview.do(actions.Answer(now.question.id, Choice.LEFT))
            until(interview, lambda now: now.pending is not None)  # the next one is chosen


def test_a_run_on_suspicion_that_took_too_long_is_not_waited_for_twice():
    with hanging(2.0, n_max=8, seed=1, ahead=True) as interview:
        on_suspicion(interview)
        assert interview.work()
        ahead = interview._driver.thoughts.prefetch
        assert ahead.is_known(BAD)
        assert "longer than 2 s" in str(ahead.take_result(BAD))
        assert not ahead.is_known(BAD)  # who tries again means it


def test_closing_ends_a_run_that_hangs_at_once_and_records_no_failure():
    with hanging(n_max=8, seed=9) as interview:
        with Background(interview):
            answer_until_it_hangs(interview)
        # Had closing waited for the run, the time limit would have made it a failure.
        assert interview.now().state.failures == {}


def test_an_unattended_study_counts_runs_that_hang_as_failed_and_ends():
    told = []
    with hanging(2.0, n_max=6, seed=1, agent=RandomSearch) as interview:
        calibrator = interview.scenario.calibrators["synthetic"](0)
        given = unattended(interview, calibrator, failed=told.append)
        ends = [comparison.challenger.end for comparison in given]
    failed = [end for end in ends if end is End.FAILED]
    assert len(ends) == 6
    assert 0 < len(failed) == len(told) < 6
    assert "failed: the run took longer than 2 s" in told[0]
    best = interview.past.experiment(interview.now().incumbent)
    assert best.end is not End.FAILED


def test_an_unattended_study_gives_up_where_every_run_hangs():
    told = []
    with isolation(HANGS, 0.3) as isolated:
        scenario = isolated(load(HANGS))
        space = scenario.space.narrowed({"gain": (50.0, 60.0)})
        interview = begin(replace(scenario, space=space), n_max=9, agent=RandomSearch)
        calibrator = scenario.calibrators["synthetic"](0)
        with pytest.raises(RunError, match=r"longer than 0.3 s"):
            list(unattended(interview, calibrator, failed=told.append))
    assert len(told) == 2
