"""A plant that runs nothing unseen, and models of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from prefcal_agents.screening.agent import Screening
from prefcal_app.session import Interview
from prefcal_app.session.study import agent_as_dict, knobs_as_dicts
from prefcal_app.simulating import Simulator
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.study import StudyFile
from prefcal_scenarios.scenario import KPI, Scenario
from support.interviews import clock
from support.unseen import run, unseen


def biased(theta: Any, seed: int = 0) -> Experiment:
    """Return what a model of `unseen` says: it is less rough than the plant."""
    experiment = run(theta, seed)
    return replace(experiment, kpis={**experiment.kpis, "rough": 0.6 * experiment.kpis["rough"]})


plant = replace(unseen, name="plant", simulated=False)
model = replace(unseen, name="model", run=biased)
renamed = replace(model, name="renamed", kpis=(KPI("speed", "speed", better="higher"),))
other_knobs = replace(
    model, name="other-knobs", space=KnobSpace([Knob("gain", 0.0, 1.0), Knob("lag", 0.0, 1.0, "s")])
)


def twinned(
    simulator: Simulator | None, *, scenario: Scenario = plant, path: Path | None = None
) -> Interview:
    """An interview about `scenario`, whose study names a twin."""
    agent = Screening(scenario.space, n_simulated=40, n_max=6)
    configuration = {
        "scenario": scenario.name,
        "name": scenario.name,
        "title": scenario.title,
        "knobs": knobs_as_dicts(scenario.space),
        "agent": agent_as_dict(agent),
        "n_max": 6,
        "seed": 0,
        "kpis": [],
        "options": {"calibrator": "human", "twin": "model"},
        "versions": {},
    }
    file = StudyFile.create(path or ":memory:", configuration, clock=clock())
    return Interview(scenario, file, ahead=False, simulator=simulator)
