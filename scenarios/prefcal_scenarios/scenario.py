"""A scenario, one calibration task described as data, and the checks of its parts and results."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isinf
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, ScenarioError
from prefcal_env.experiments.experiment import Controller, Experiment, check_returned
from prefcal_env.experiments.kpis import KPI as KPI
from prefcal_env.experiments.kpis import Formulas, Tracking, every_tracking_kpi, found_kpis, tracking_kpis
from prefcal_env.experiments.panels import Panel as Panel
from prefcal_env.experiments.panels import Plot, plots_of
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Calibrator
from prefcal_env.sources.source import KPIsOf, Source, source_of, with_space
from prefcal_env.units import same
from prefcal_env.wording import did_you_mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Picture:
    """One figure of a report.

    Its functions take the report's record of the study, see `report/record.py` of `prefcal_app`.
    """

    file: str  # name of its file, .png
    title: str  # heading
    # description in a sentence or two, or a function of the record that returns it
    caption: str | Callable[[Any], str]
    # function of the record that returns a text for people who cannot see the figure
    alt: Callable[[Any], str]
    # function of the record that returns a figure, or the content of the file
    draw: "Callable[[Any], Figure | bytes]"
    # function that tells whether the study has the necessary data; by default, always
    applies: Callable[[Any], bool] = lambda record: True


class _Unstated(tuple[KPI, ...]):
    """No KPIs, because the scenario states none: they are found."""


UNSTATED: tuple[KPI, ...] = _Unstated()
"""The KPIs of a scenario that leaves them out; `()` says that it has none."""


@dataclass(frozen=True)
class Scenario:
    """A calibration task.

    Args:
        name: Short name, as in `prefcal calibrate NAME`.
        title: Title for headings.
        space: Knobs to calibrate.
        run: Function that runs one experiment for a physical θ, or any other `Source`.
        cost: Latent cost of an experiment, lower is better; None if there is no single score.
        kpis: KPIs of an experiment, in order of importance. If left out, tracking KPIs are found
            (see `prefcal_env.tracking_kpis`): at once if `run` declares channels with targets,
            otherwise in the first experiment. () states that there are none.
        panels: Plots of an experiment from top to bottom, each named by its channel. If empty,
            plots every state and input, and every output that is not a state.
        references: Named θ to compare with, for example the paper's, physical, shape (n,).
        calibrators: Synthetic calibrators by name, each a function of a seed.
        controller: Function that builds the tuned controller for a θ.
        settings: Function that returns the controller's settings for a θ as JSON-able data, for
            the export.
        brief: Description of the task in a few sentences, for the person who compares.
        configured: Function that returns the scenario for another configuration, given as plain
            data, as read by `--config`.
        simulated: Whether `prefcal calibrate` simulates many experiments unseen; they must be
            quick simulations.
        assumed: What nobody stated and the controller has, a sentence each, such as limits of an input.
        pictures: Function that returns the scenario's own figures, shown above the report's
            standard ones. It is a function so that plotting is imported only for reports.

    Attributes:
        source: `run` as a source: what turns θ into an experiment.

    Raises:
        ScenarioError: If a part has the wrong type, a reference θ does not fit the space, two
            KPIs share a name, or `run` is known not to return a panel or KPI. If `run` declares
            no `channels`, they are checked after the first experiment (see
            `prefcal_scenarios.scenario`), or `simulated` is set for a rig.
    """

    name: str
    title: str
    space: KnobSpace
    run: Callable[..., Experiment]
    cost: Callable[[Experiment], float] | None = None
    kpis: tuple[KPI, ...] = UNSTATED
    panels: tuple[Panel, ...] = ()
    references: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    calibrators: Mapping[str, Callable[..., Calibrator[Experiment]]] = field(default_factory=dict)
    controller: Callable[[Float[np.ndarray, " n"]], Controller] | None = None
    settings: Callable[[Float[np.ndarray, " n"]], dict[str, Any]] | None = None
    pictures: Callable[[], Sequence[Picture]] | None = None
    configured: "Callable[[Mapping[str, Any]], Scenario] | None" = None
    brief: str = ""
    simulated: bool = False
    assumed: tuple[str, ...] = ()
    source: Source = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not callable(self.run):
            raise ScenarioError(f"scenario {self.name!r}: run must be a function of θ, got {self.run!r}")
        object.__setattr__(self, "source", source_of(self.run))
        if isinstance(self.kpis, _Unstated):
            channels = self.source.channels
            if found := () if channels is None else found_kpis(channels):
                object.__setattr__(self, "kpis", found)
            names = [kpi.name for kpi in found]
            self._measure(lambda there: Tracking.promised(there, names))
        check_parts(self)
        if formulas := tuple((k.name, k.formula, k.unit) for k in self.kpis if k.formula):
            self._measure(lambda _: Formulas(formulas))

    def _measure(self, kpis_of: KPIsOf) -> None:
        """Let experiments have more KPIs than their own."""
        source = self.source.measured(kpis_of)
        object.__setattr__(self, "run", source)
        object.__setattr__(self, "source", source)

    @property
    def shown_kpis(self) -> tuple[KPI, ...]:
        """Return the KPIs that people see, limited ones first: all but the index, which no person chose."""
        shown = [k for k in self.kpis if not k.of and (self.cost is None or k.name != "index")]
        return tuple(sorted(shown, key=lambda kpi: isinf(kpi.at_most) and isinf(kpi.at_least)))


def finds_kpis(scenario: Scenario) -> bool:
    """Return whether the scenario's KPIs are still to be found in its first experiment."""
    return isinstance(scenario.kpis, _Unstated)


def with_found_kpis(scenario: Scenario, experiment: Experiment) -> Scenario:
    """Return `scenario` with the tracking KPIs of `experiment` if it states none."""
    if not finds_kpis(scenario):
        return scenario
    found = found_kpis(experiment.channels, experiment.kpis)
    return replace(scenario, kpis=found) if found else scenario


def described(kpis: Sequence[KPI], about: Mapping[str, str]) -> tuple[KPI, ...]:
    """Return the KPIs with the explanations in `about`, which maps KPI names to sentences.

    Raises:
        ScenarioError: If a name matches no KPI.
    """
    unknown = sorted(set(about) - {kpi.name for kpi in kpis})
    if unknown:
        raise ScenarioError(f"about must name some of the KPIs, got {unknown}")
    return tuple(replace(kpi, about=about.get(kpi.name, kpi.about)) for kpi in kpis)


def panels_of(scenario: Scenario, *experiments: Experiment) -> tuple[Plot, ...]:
    """Return the plots to draw for one or more experiments, the same for all of them.

    These are the scenario's panels or, if it has none, one for each state, each input, and each
    output that is not a state. A panel is empty if no experiment has its curve, for example
    because they ran before it was added.
    """
    recorded = [e for e in experiments if len(e.t)] or list(experiments)
    if not scenario.panels:
        plots = plots_of(recorded[0].channels, recorded[0].signals)
        return tuple(plot for plot in plots if plot.kind != "signal")
    return tuple(_plot(panel, recorded) for panel in scenario.panels)


def _plot(panel: Panel, experiments: Sequence[Experiment]) -> Plot:
    for experiment in experiments:
        try:
            return panel.plot(experiment)
        except ScenarioError:
            continue
    return panel.absent()


def with_ranges(scenario: Scenario, space: KnobSpace) -> Scenario:
    """Return `scenario` with the knobs of `space`, whose ranges may be wider than its own.

    If its `run`, `controller` or `settings` takes an argument `space`, it receives the new space,
    so that functions that check θ accept the wider ranges.
    """
    return replace(
        scenario,
        space=space,
        run=scenario.source.within(space),
        controller=with_space(scenario.controller, space),
        settings=with_space(scenario.settings, space),
    )


# --- Check a scenario: its parts before anything runs, and its results after one experiment.

_ROUNDED = 0.1  # largest rounding of θ by a plant, as a share of the knob's range


def check_parts(scenario: Scenario) -> None:
    """Check everything about a scenario that is known before it runs.

    Raises:
        ScenarioError: See `Scenario`.
    """
    where = f"scenario {scenario.name!r}"
    if not isinstance(scenario.space, KnobSpace):
        raise ScenarioError(f"{where}: space must be a KnobSpace, got {scenario.space!r}")
    _check_types(scenario, where)
    if not isinstance(scenario.simulated, bool):
        raise ScenarioError(f"{where}: simulated must be True or False, got {scenario.simulated!r}")
    if scenario.simulated and scenario.source.asks:
        raise ScenarioError(f"{where}: simulated must be False for a rig, whose experiments a person runs")
    for problem in scenario.source.problems(scenario.kpis):
        raise ScenarioError(f"{where}: {problem}")
    names = [kpi.name for kpi in scenario.kpis]
    if twice := sorted({name for name in names if names.count(name) > 1}):
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
    experiment = check_returned(result)
    wrong = [
        *theta_problems(scenario.space, theta, experiment),
        *panel_problems(scenario, experiment),
        *([] if experiment.end.interrupted else kpi_problems(scenario, experiment.kpis)),
        *_unit_problems(scenario, experiment),
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


def _unit_problems(scenario: Scenario, experiment: Experiment) -> Iterator[str]:
    """Yield the tracking KPIs that the scenario states in another unit than they are computed in."""
    usual = every_tracking_kpi(experiment.channels)
    for kpi in scenario.kpis:
        unit = usual[kpi.name].unit if kpi.name in usual and not kpi.formula else ""
        # A run may compute it by itself, in its own unit.
        differs = unit and kpi.unit and not same(unit, kpi.unit)
        if differs and experiment.kpis.get(kpi.name) == tracking_kpis(experiment).get(kpi.name):
            yield f"the KPI {kpi.name!r} is computed in {unit}, but the scenario says {kpi.unit}"


def kpi_problems(scenario: Scenario, kpis: Mapping[str, float]) -> Iterator[str]:
    """Yield the scenario's KPIs that no run has returned."""
    missing = [name for kpi in scenario.kpis if (name := kpi.of or kpi.name) not in kpis]
    if missing and not kpis:
        yield f"no run returns the KPI {missing[0]!r}, or any other: is kpis= or a return missing?"
        return
    there = ", ".join(map(repr, kpis))
    for name in missing:
        yield f"no run returns the KPI {name!r}; there are {there}.{did_you_mean(name, kpis)}"
