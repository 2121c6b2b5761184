"""Interviews with an agent that simulates, and what it is said to know."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_agents.screening.agent import Screening
from prefcal_env.study import StudyFile
from prefcal_scenarios.app.session import Interview
from prefcal_scenarios.app.session.memory import agent_as_dict, knobs_as_dicts
from prefcal_scenarios.kpis import outcome, seen
from prefcal_scenarios.scenario import Scenario
from support.interviews import clock, proceed
from toy_study import toy_scenario

toy = toy_scenario()


def simulate(theta: Any, scenario: Scenario = toy) -> dict[str, float]:
    """KPIs that people see of an experiment of the toy; none for N_p = 7: it fails."""
    if theta[1] == 7:
        return {}
    known = outcome(scenario, scenario.run(np.array(theta)))
    return {name: value for name, value in known.items() if name in seen(scenario)}


def screening(
    scenario: Scenario = toy, *, n_max: int = 6, path: Path | None = None, simulated: int = 80,
) -> Interview:  # fmt: skip
    """An interview of an agent that simulates 80 θ, before its first step."""
    agent = Screening(
        scenario.space, simulate=partial(simulate, scenario=scenario), n_simulated=simulated,
        n_max=n_max,
    )  # fmt: skip
    configuration = {
        "scenario": scenario.name, "name": scenario.name, "title": scenario.title,
        "knobs": knobs_as_dicts(scenario.space),
        "agent": agent_as_dict(agent.copy()), "n_max": n_max,
        "seed": 0, "kpis": [], "options": {"calibrator": "human"}, "versions": {},
    }  # fmt: skip
    file = StudyFile.create(path or ":memory:", configuration, clock=clock())
    return simulating(Interview(scenario, file, ahead=False, asks=False))


def simulating(interview: Interview) -> Interview:
    """An interview that was only read, given its simulations, at its next step."""
    flow = interview._flow
    assert isinstance(flow.agent, Screening)
    flow.agent = flow.agent.with_simulations(partial(simulate, scenario=interview.scenario))
    flow.resume()
    return interview


def explained(interview: Interview) -> Interview:
    """The interview with its next question open and everything about it worked out."""
    proceed(interview)
    while interview.screened() is None:
        assert interview.work()
    return interview
