"""Use a cost of the user's choice in place of a scenario's score: a function, or a KPI."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf
from numbers import Real
from pathlib import Path
from typing import Any

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.kpis import outcome
from prefcal_scenarios.own.own_file import module_at
from prefcal_scenarios.scenario import Scenario, finds_kpis


@dataclass(frozen=True, slots=True)
class FileCost:
    """Cost function of an experiment, lower is better, with checked values.

    Args:
        source: Origin of the function, PATH:NAME.
        function: Function that takes an experiment and returns a number.
    """

    source: str
    function: Callable[[Experiment], Any]

    def __call__(self, experiment: Experiment) -> float:
        """Return the cost of `experiment`. Raises ScenarioError if it is not a finite number."""
        value = self.function(experiment)
        finite = isinstance(value, Real) and abs(float(value)) < float("inf")
        if not finite or isinstance(value, bool):
            raise ScenarioError(
                f"cost {self.source!r} must give a finite number, got {value!r} at θ = "
                f"{experiment.theta.tolist()}. A KPI can be infinite, such as a settling time: "
                "bound it, for example min(kpis['settling_time'], 1e3)"
            )
        return float(value)


@dataclass(frozen=True, slots=True)
class KPICost:
    """A KPI as the cost of an experiment, lower is better; infinite for a run that was stopped.

    Args:
        name: Name of the KPI.
        scenario: Scenario that has it, or that finds its KPIs in the first experiment.
    """

    name: str
    scenario: Scenario

    def __call__(self, experiment: Experiment) -> float:
        """Return the cost of `experiment`.

        Raises:
            ScenarioError: If it ran to its end and has no such KPI.
        """
        if not len(experiment.t) or experiment.end.interrupted:
            return inf  # it may have stopped before the KPI could be measured
        found = outcome(self.scenario, experiment)
        if self.name not in found:
            raise ScenarioError(_no_cost(self.name, found))
        return found[self.name]


def is_program(source: str) -> bool:
    """Return whether a cost is a function of a file, and not the name of a KPI."""
    path, _, name = source.rpartition(":")
    return path.endswith(".py") and bool(name)


def kept_cost(stored: Mapping[str, Any]) -> str | None:
    """Return the cost to use again from the options that a study keeps; None for a program.

    A study from another person must not decide which program runs here; a KPI's name is none.
    """
    cost = stored.get("cost")
    return None if cost is None or is_program(str(cost)) else str(cost)


def with_cost(scenario: Scenario, source: str | None) -> Scenario:
    """Return `scenario` with another cost.

    Args:
        scenario: Scenario whose cost is replaced.
        source: PATH:NAME of a function, or the name of a KPI; None leaves the scenario unchanged.

    Raises:
        ScenarioError: If there is no such KPI, the file or the name in it does not exist, or it
            cannot be called.
    """
    if source is None:
        return scenario
    path, _, name = source.rpartition(":")
    if not is_program(source):
        names = [kpi.name for kpi in scenario.kpis if kpi.goal is not None]
        if source not in names and not finds_kpis(scenario):
            raise ScenarioError(_no_cost(source, names))
        return replace(scenario, cost=KPICost(source, scenario))
    found = getattr(module_at(Path(path)), name, None)
    if not callable(found):
        got = "nothing of that name" if found is None else repr(found)
        raise ScenarioError(f"cost {source!r} must be a function of an experiment, got {got}")
    return replace(scenario, cost=FileCost(source, found))


def _no_cost(source: str, names: Iterable[str]) -> str:
    there = ", ".join(map(repr, names)) or "none"
    return (
        f"a cost must be path/to/own.py:NAME or a KPI of the scenario with a good direction "
        f"({there}), got {source!r}.{did_you_mean(source, names)}".rstrip(".")
    )
