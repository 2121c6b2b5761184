"""What an agent may learn of an experiment beside θ: the scenario's KPIs and generic ones."""

from collections.abc import Mapping

import numpy as np

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.preferences.kpis import Outcome

from .scenario import KPI, Scenario

INTERRUPTED = "interrupted"
"""Name of the KPI that is 1 for a run that was stopped or failed, and 0 else."""


def outcome(scenario: Scenario, experiment: Experiment) -> Outcome:
    """KPIs of `experiment` by name, lower is better; infinite means never or as bad as can be.

    The scenario's KPIs whose good direction is known, and the generic ones of any trajectory
    with a reference. Of a run that was stopped all are infinite: a short run has small errors.
    """
    stopped = experiment.end.interrupted
    known = {} if not len(experiment.t) else dict(tracking_kpis(experiment))
    for kpi in scenario.kpis:
        value = experiment.kpis.get(kpi.name)
        if value is not None and kpi.goal is not None:
            known[kpi.name] = kpi.badness(float(value))
    if stopped:
        known = dict.fromkeys(known, np.inf)
    return Outcome({**known, INTERRUPTED: float(stopped)})


def seen(scenario: Scenario) -> tuple[str, ...]:
    """Names of the KPIs that a person sees and the agent learns from, in order of importance."""
    return (*(kpi.name for kpi in scenario.kpis if kpi.goal is not None), INTERRUPTED)


def titles(scenario: Scenario) -> Mapping[str, str]:
    """Name to title of the KPIs whose name is not for people."""
    return {INTERRUPTED: "runs that were stopped"} | {
        kpi.name: _title(kpi) for kpi in scenario.kpis
    }


def _title(kpi: KPI) -> str:
    return f"{kpi.title} near its target" if kpi.goal == "target" else kpi.title
