"""What an agent can learn about an experiment besides θ: the scenario's KPIs and generic ones."""

from collections.abc import Mapping

import numpy as np

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.preferences.kpis import Outcome

from .scenario import KPI, Scenario

INTERRUPTED = "interrupted"
"""Name of the KPI that is 1 for a run that was stopped or failed, and 0 otherwise."""


def outcome(scenario: Scenario, experiment: Experiment) -> Outcome:
    """Return the KPIs of `experiment` by name, lower is better; infinite is the worst value.

    They are the scenario's KPIs with a known direction of improvement, and generic KPIs of any
    trajectory with a reference. All are infinite for a run that was stopped: a short run would
    otherwise look good, since it accumulates little error.
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
    """Return the names of the KPIs that people see and agents use, in order of importance."""
    return (*(kpi.name for kpi in scenario.kpis if kpi.goal is not None), INTERRUPTED)


def titles(scenario: Scenario) -> Mapping[str, str]:
    """Return titles by name for the KPIs whose names are not meant for people."""
    return {INTERRUPTED: "runs that were stopped"} | {
        kpi.name: _title(kpi) for kpi in scenario.kpis
    }


def _title(kpi: KPI) -> str:
    return f"{kpi.title} near its target" if kpi.goal == "target" else kpi.title
