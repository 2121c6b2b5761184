"""Interviews of the toy with an agent that simulates it."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_agents.screening import findings
from prefcal_agents.screening.agent import Screening
from prefcal_app.session import Interview
from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.scenario import Scenario
from support.interviews import begin, proceed
from toy_study import toy_scenario

toy = toy_scenario()


def run(theta: Any, seed: int = 0) -> Experiment:
    """The toy's run; one with N_p = 7 raises an error."""
    if theta[1] == 7:
        raise OSError("no solution")
    return toy.run(np.array(theta), seed=seed)


simulated = replace(toy, run=run, simulated=True)


def screening(
    scenario: Scenario = simulated, *, n_max: int = 6, path: Path | None = None, count: int = 80
) -> Interview:
    """An interview of an agent that simulates `count` θ, before its first step."""
    agent = partial(Screening, n_simulated=count)
    return begin(scenario, n_max=n_max, path=path, agent=agent)


def let_say(monkeypatch: Any, part: str = "_explain_query", **fields: Any) -> list[object]:
    """Let a part of all findings say this; return the agents that were asked so far.

    The first part says it only where it has something of that kind to say.
    """
    worked_out, asked = getattr(findings, part), list[object]()

    def said(agent: Screening, known: findings.Findings) -> findings.Findings:
        asked.append(agent)
        found = worked_out(agent, known)
        every = part != "_explain_query"
        return replace(found, **{k: v for k, v in fields.items() if every or getattr(found, k) is not None})

    monkeypatch.setattr(findings, part, said)
    return asked


def explained(interview: Interview) -> Interview:
    """The interview with its next question open and everything about it worked out."""
    proceed(interview)
    while interview.known.findings is None or interview.known.screened() is None:
        assert interview.work()
    return interview
