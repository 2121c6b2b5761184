"""A scenario: one calibration task described as data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.kpi import KPI as KPI
from prefcal_env.experiments.panels import Panel as Panel
from prefcal_env.experiments.panels import Plot, plots_of
from prefcal_env.experiments.tracking import Formulas, Tracking, found_kpis
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Calibrator
from prefcal_env.sources.function import source_of, with_space
from prefcal_env.sources.source import KPIsOf, Source
from prefcal_scenarios.own.checks import check_parts

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Picture:
    """One figure of a report.

    Its functions take the report's record of the study, see `report/record.py` of `prefcal_app`.

    Args:
        file: Name of its file, .png.
        title: Heading.
        caption: Description in a sentence or two, or a function of the record that returns it.
        alt: Function of the record that returns a text for people who cannot see the figure.
        draw: Function of the record that returns a figure, or the content of the file.
        applies: Function that tells whether the study has the necessary data; by default, always.
    """

    file: str
    title: str
    caption: str | Callable[[Any], str]
    alt: Callable[[Any], str]
    draw: "Callable[[Any], Figure | bytes]"
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
        pictures: Function that returns the scenario's own figures, shown above the report's
            standard ones. It is a function so that plotting is imported only for reports.

    Attributes:
        source: `run` as a source: what turns θ into an experiment.

    Raises:
        ScenarioError: If a part has the wrong type, a reference θ does not fit the space, two
            KPIs share a name, or `run` is known not to return a panel or KPI. If `run` declares
            no `channels`, they are checked after the first experiment (see
            `prefcal_scenarios.own.checks`), or `simulated` is set for a rig.
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
        if formulas := tuple((kpi.name, kpi.formula) for kpi in self.kpis if kpi.formula):
            self._measure(lambda _: Formulas(formulas))

    def _measure(self, kpis_of: KPIsOf) -> None:
        """Let experiments have more KPIs than their own."""
        source = self.source.measured(kpis_of)
        object.__setattr__(self, "run", source)
        object.__setattr__(self, "source", source)

    @property
    def shown_kpis(self) -> tuple[KPI, ...]:
        """Return the KPIs to show to people: all except the index, which no person chose."""
        return tuple(k for k in self.kpis if self.cost is None or k.name != "index")


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
