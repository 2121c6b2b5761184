"""What an agent can learn about an experiment besides θ: the scenario's KPIs and generic ones."""

from collections.abc import Mapping

import numpy as np

from prefcal_env.experiments.experiment import End, Experiment
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
    known = {} if not len(experiment.t) else dict(tracking_kpis(experiment))
    return _outcome({**known, **_directed(scenario, experiment.kpis)}, experiment.end)


def has_direction(scenario: Scenario) -> bool:
    """Return whether some KPI of the scenario has a known direction of improvement."""
    return any(kpi.goal is not None for kpi in scenario.kpis)


def outcome_of(scenario: Scenario, kpis: Mapping[str, float], end: End) -> Outcome:
    """Return the `outcome` of an experiment whose trajectories are not kept: see `seen`.

    Args:
        scenario: Scenario of the experiment.
        kpis: KPIs of the experiment by name, as the scenario computes them.
        end: Why the experiment ended.
    """
    return _outcome(_directed(scenario, kpis), end)


def _directed(scenario: Scenario, kpis: Mapping[str, float]) -> dict[str, float]:
    return {
        kpi.name: kpi.badness(float(kpis[kpi.name]))
        for kpi in scenario.kpis
        if kpi.goal is not None and kpis.get(kpi.name) is not None
    }


def _outcome(known: Mapping[str, float], end: End) -> Outcome:
    stopped = end.interrupted
    values = dict.fromkeys(known, np.inf) if stopped else known
    return Outcome({**values, INTERRUPTED: float(stopped)})


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
