"""Whether a scenario is in order: what is known before anything runs, and after one experiment."""

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, ScenarioError
from prefcal_env.experiments.experiment import Channels, Experiment
from prefcal_env.experiments.panels import Panel
from prefcal_env.knobs.knob import KnobSpace

if TYPE_CHECKING:
    from prefcal_scenarios.scenario import Scenario

_ROUNDED = 0.1
"""Share of a knob's range that a plant may round θ by."""


def check_parts(scenario: "Scenario", kpi: type) -> None:
    """Refuse what is known to be wrong before anything runs; `kpi` is the type of its KPIs.

    Raises:
        ScenarioError: as `Scenario` says.
    """
    where = f"scenario {scenario.name!r}"
    if not isinstance(scenario.space, KnobSpace):
        raise ScenarioError(f"{where}: space must be a KnobSpace, got {scenario.space!r}")
    if not callable(scenario.run):
        raise ScenarioError(f"{where}: run must be a function of θ, got {scenario.run!r}")
    _check_types(scenario, kpi, where)
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


def _check_types(scenario: "Scenario", kpi: type, where: str) -> None:
    for field, type_, example in (("panels", Panel, "Panel('level')"), ("kpis", kpi, "KPI(...)")):
        values: Any = getattr(scenario, field)
        if isinstance(values, type_):
            raise ScenarioError(
                f"{where}: {field} must be a tuple; of one write ({example},) with its comma"
            )
        if not isinstance(values, tuple | list):
            raise ScenarioError(f"{where}: {field} must be a tuple, got {values!r}")
        strangers = [value for value in values if not isinstance(value, type_)]
        if strangers:
            raise ScenarioError(f"{where}: {field} must hold {example}, got {strangers[0]!r}")
        object.__setattr__(scenario, field, tuple(values))
    for field in (
        "cost", "controller", "settings", "scene", "pictures", "configured", "on_processor",
    ):  # fmt: skip
        value = getattr(scenario, field)
        if value is not None and not callable(value):
            raise ScenarioError(f"{where}: {field} must be a function or None, got {value!r}")
    for name, make in scenario.calibrators.items():
        if not callable(make):
            raise ScenarioError(
                f"{where}: calibrator {name!r} must be made by a function of the seed, got {make!r}"
            )


def _check_against_run(scenario: "Scenario", where: str) -> None:
    """Compare with what the run says of its experiments, as a `Rig` and a `ClosedLoop` do."""
    channels = getattr(scenario.run, "channels", None)
    signals = getattr(scenario.run, "signals", None)
    if isinstance(channels, Channels) and signals is not None:
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
    if scenario.kpis and getattr(scenario.run, "kpis", ...) is None:
        raise ScenarioError(
            f"{where}: it has the KPI {scenario.kpis[0].name!r}, but its run computes none: "
            "give the run a function kpis(experiment)"
        )


def check_experiment(
    scenario: "Scenario", theta: Float[np.ndarray, " n"], result: object
) -> Experiment:
    """Return `result` if it is the experiment that the scenario promises of θ.

    KPIs that are missing are forgiven if the run was interrupted: there may be nothing to measure.

    Raises:
        ScenarioError: everything that is wrong, with the names that there are.
    """
    if not isinstance(result, Experiment):
        forgotten = ": is a return missing?" if result is None else ""
        raise ScenarioError(
            f"run must return an Experiment, got {type(result).__name__}{forgotten}"
        )
    wrong = [
        *theta_problems(scenario.space, theta, result),
        *panel_problems(scenario, result),
        *([] if result.end.interrupted else kpi_problems(scenario, result.kpis)),
    ]
    if wrong:
        raise ScenarioError(
            f"scenario {scenario.name!r} does not fit its own experiment: {'; '.join(wrong)}. "
            "Mend its file and start again"
        )
    return result


def theta_problems(
    space: KnobSpace, theta: Float[np.ndarray, " n"], experiment: Experiment
) -> Iterator[str]:
    """Say whether the experiment is of another θ, physical, shape (n,), than was asked for.

    A plant may round what it is given: a tenth of a knob's range is too much for that.
    """
    got = experiment.theta
    if got.shape != (len(space),):
        yield f"its theta has shape {got.shape}, but {len(space)} knobs were given"
        return
    for knob, asked, ran in zip(space, theta, got, strict=True):
        if knob.low <= ran <= knob.high and abs(knob.encode(ran) - knob.encode(asked)) <= _ROUNDED:
            continue
        yield f"it says that it ran {knob.name} = {ran:g}, but {asked:g} was to be run"


def panel_problems(scenario: "Scenario", experiment: Experiment) -> Iterator[str]:
    """Say which panels have no curve; of each run, if the experiment has several."""
    if not len(experiment.t):
        return
    for panel in scenario.panels:
        try:
            for run in experiment.runs or (experiment,):
                if len(run.t):
                    panel.plot(run)
        except ScenarioError as error:
            yield str(error)


def kpi_problems(scenario: "Scenario", kpis: Mapping[str, float]) -> Iterator[str]:
    """Say which KPIs of the scenario are not among those that a run has returned."""
    missing = [kpi.name for kpi in scenario.kpis if kpi.name not in kpis]
    if missing and not kpis:
        yield f"no run returns the KPI {missing[0]!r}, or any other: is kpis= or a return missing?"
        return
    there = ", ".join(map(repr, kpis))
    for name in missing:
        close = get_close_matches(name, kpis, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        yield f"no run returns the KPI {name!r}; {hint}There are {there}"
