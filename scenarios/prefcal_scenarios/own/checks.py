"""Check a scenario: its parts before anything runs, and its results after one experiment."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, ScenarioError
from prefcal_env.experiments.experiment import Experiment, returned
from prefcal_env.experiments.kpi import KPI
from prefcal_env.experiments.panels import Panel
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.wording import did_you_mean

Scenario = Any
"""`prefcal_scenarios.scenario.Scenario`, which calls these checks while it is being made."""
_ROUNDED = 0.1
"""Largest rounding of θ by a plant, as a share of the knob's range."""


def check_parts(scenario: Scenario) -> None:
    """Check everything about a scenario that is known before it runs.

    Raises:
        ScenarioError: See `Scenario`.
    """
    where = f"scenario {scenario.name!r}"
    if not isinstance(scenario.space, KnobSpace):
        raise ScenarioError(f"{where}: space must be a KnobSpace, got {scenario.space!r}")
    _check_types(scenario, where)
    _check_simulated(scenario, where)
    for problem in scenario.source.problems(scenario.kpis):
        raise ScenarioError(f"{where}: {problem}")
    names = [kpi.name for kpi in scenario.kpis]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ScenarioError(f"{where}: the names of KPIs must differ, got {twice} more than once")
    for name, theta in scenario.references.items():
        try:
            scenario.space.check(theta)
        except KnobError as error:
            raise ScenarioError(f"reference {name!r} of {scenario.name!r}: {error}") from error
    _check_against_run(scenario, where)


def _check_types(scenario: Scenario, where: str) -> None:
    for part, type_, example in (("panels", Panel, "Panel('level')"), ("kpis", KPI, "KPI(...)")):
        values: Any = getattr(scenario, part)
        if isinstance(values, type_):
            raise ScenarioError(f"{where}: {part} must be a tuple; of one write ({example},) with its comma")
        if not isinstance(values, tuple | list):
            raise ScenarioError(f"{where}: {part} must be a tuple, got {values!r}")
        strangers = [value for value in values if not isinstance(value, type_)]
        if strangers:
            raise ScenarioError(f"{where}: {part} must hold {example}, got {strangers[0]!r}")
        if isinstance(values, list):  # a tuple may say that the KPIs are left out
            object.__setattr__(scenario, part, tuple(values))
    for part in ("cost", "controller", "settings", "pictures", "configured"):
        value = getattr(scenario, part)
        if value is not None and not callable(value):
            raise ScenarioError(f"{where}: {part} must be a function or None, got {value!r}")
    for name, make in scenario.calibrators.items():
        if not callable(make):
            raise ScenarioError(
                f"{where}: calibrator {name!r} must be made by a function of the seed, got {make!r}"
            )


def _check_simulated(scenario: Scenario, where: str) -> None:
    if not isinstance(scenario.simulated, bool):
        raise ScenarioError(f"{where}: simulated must be True or False, got {scenario.simulated!r}")
    if scenario.simulated and scenario.source.asks:
        raise ScenarioError(f"{where}: simulated must be False for a rig, whose experiments a person runs")


def _check_against_run(scenario: Scenario, where: str) -> None:
    """Check the scenario against the channels and KPIs that its run declares, if it does."""
    channels, signals = scenario.source.channels, scenario.source.signals
    if channels is not None and signals is not None:
        for panel in scenario.panels:
            try:
                panel.among(channels, signals)
            except ScenarioError as error:
                raise ScenarioError(f"{where}: {error}") from error
            if panel.reference and panel.reference not in signals:
                raise ScenarioError(
                    f"{where}: panel {panel.name!r}: no signal is called {panel.reference!r} to "
                    "draw the reference"
                )
    returned = [kpi.name for kpi in scenario.kpis if not kpi.formula]
    if returned and not scenario.source.computes_kpis:
        raise ScenarioError(
            f"{where}: it has the KPI {returned[0]!r}, but its run computes none: "
            "give the run a function kpis(experiment)"
        )


def check_experiment(scenario: Scenario, theta: Float[np.ndarray, " n"], result: object) -> Experiment:
    """Return `result` if it is the experiment that the scenario promises for θ.

    An interrupted run may lack KPIs, since there may be nothing to measure.

    Raises:
        ScenarioError: If anything is wrong; the message lists every problem and the names that
            exist.
    """
    experiment = returned(result)
    wrong = [
        *theta_problems(scenario.space, theta, experiment),
        *panel_problems(scenario, experiment),
        *([] if experiment.end.interrupted else kpi_problems(scenario, experiment.kpis)),
    ]
    if wrong:
        raise ScenarioError(
            f"scenario {scenario.name!r} does not fit its own experiment: {'; '.join(wrong)}. "
            "Fix its file and start again"
        )
    return experiment


def theta_problems(space: KnobSpace, theta: Float[np.ndarray, " n"], experiment: Experiment) -> Iterator[str]:
    """Yield a problem if the experiment ran another θ, physical, shape (n,), than requested.

    A plant may round θ, but by less than a tenth of a knob's range.
    """
    got = experiment.theta
    if got.shape != (len(space),):
        yield f"its theta has shape {got.shape}, but {len(space)} knobs were given"
        return
    for knob, asked, ran in zip(space, theta, got, strict=True):
        if knob.low <= ran <= knob.high and abs(knob.encode(ran) - knob.encode(asked)) <= _ROUNDED:
            continue
        yield f"it says that it ran {knob.name} = {ran:g}, but {asked:g} was to be run"


def panel_problems(scenario: Scenario, experiment: Experiment) -> Iterator[str]:
    """Yield the panels that have no curve, for each run if the experiment has several."""
    if not len(experiment.t):
        return
    for panel in scenario.panels:
        try:
            for run in experiment.runs or (experiment,):
                if len(run.t):
                    panel.plot(run)
        except ScenarioError as error:
            yield str(error)


def kpi_problems(scenario: Scenario, kpis: Mapping[str, float]) -> Iterator[str]:
    """Yield the scenario's KPIs that no run has returned."""
    missing = [kpi.name for kpi in scenario.kpis if kpi.name not in kpis]
    if missing and not kpis:
        yield f"no run returns the KPI {missing[0]!r}, or any other: is kpis= or a return missing?"
        return
    there = ", ".join(map(repr, kpis))
    for name in missing:
        yield f"no run returns the KPI {name!r}; there are {there}.{did_you_mean(name, kpis)}"
