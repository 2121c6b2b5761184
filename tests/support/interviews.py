"""Interviews for tests: begun in memory or in a file, and worked without a thread."""

import itertools
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from prefcal_agents import GLISp, GLISpSettings
from prefcal_app.session import Choice, Interview, Now, Phase, Question, actions
from prefcal_app.session.study import agent_as_dict, knobs_as_dicts
from prefcal_env.study import StudyFile
from prefcal_scenarios.scenario import Scenario

THREE = partial(GLISp, settings=GLISpSettings(questions_per_experiment=3))
"""An agent that asks up to three questions for each experiment."""


def clock() -> Any:
    """A clock that gives another second each time."""
    seconds = itertools.count()
    return lambda: f"2026-01-01T00:{(s := next(seconds)) // 60 % 60:02d}:{s % 60:02d}+00:00"


def begin(
    scenario: Scenario,
    *,
    n_max: int = 6,
    seed: int = 0,
    path: Path | None = None,
    ahead: bool = False,
    agent: Any = GLISp,
    at_once: int = 1,
    stops: bool = False,
) -> Interview:
    """An interview of `agent`, a class, about `scenario`."""
    agent = agent(scenario.space, n_init=3, n_max=n_max, seed=seed)
    configuration = {
        "scenario": scenario.name,
        "name": scenario.name,
        "title": scenario.title,
        "knobs": knobs_as_dicts(scenario.space),
        "agent": agent_as_dict(agent),
        "n_max": n_max,
        "seed": seed,
        "kpis": [],
        "options": {"calibrator": "human" if stops else "a test"},
        "versions": {},
    }
    file = StudyFile.create(path or ":memory:", configuration, clock=clock())
    return Interview(scenario, file, ahead=ahead, at_once=at_once)


def reopened(scenario: Scenario, path: Path, at_once: int = 1) -> Interview:
    """The interview of a study file."""
    return Interview(scenario, StudyFile.open(path, clock=clock()), ahead=False, at_once=at_once)


def proceed(interview: Interview) -> Now:
    """Work until something is waited for that is not work."""
    while interview.now().phase is Phase.RUNNING:
        assert interview.work()
    return interview.now()


def worked(interview: Interview) -> Now:
    """Do all the work that there is, also what is done ahead of an answer."""
    while interview.work():
        pass
    return interview.now()


def until(interview: Interview, wanted: Callable[[Now], Any], seconds: float = 20.0) -> Now:
    """Wait for a moment of an interview that works in the background, as `wanted` says."""
    end = time.monotonic() + seconds
    while not wanted(now := interview.now()):
        assert time.monotonic() < end, f"{now.phase} {now.problem}"
        time.sleep(0.01)
    return now


def judge(question: Question, cost: Any) -> Choice:
    """The choice by a latent cost."""
    left, right = cost(question.left.experiment), cost(question.right.experiment)
    return Choice.LEFT if left < right else Choice.RIGHT if right < left else Choice.SAME


def until_further(interview: Interview) -> Question:
    """Answer until a further question is open: that question."""
    while True:
        question = proceed(interview).question
        assert question is not None
        if question.further:
            return question
        interview.do(actions.Answer(question.id, judge(question, interview.scenario.cost)))


def answer_all(interview: Interview, answered: Callable[[int], None]) -> None:
    """Answer by the scenario's latent cost until it is over, saying each number when it is safe."""
    cost = interview.scenario.cost
    assert cost is not None
    while (now := proceed(interview)).question is not None:
        interview.do(actions.Answer(now.question.id, judge(now.question, cost)))
        answered(now.question.number)
