"""A scenario: one calibration task described as data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Panel as Panel
from prefcal_env.experiments.panels import Plot, plots_of
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Calibrator
from prefcal_env.preferences.reading import as_read
from prefcal_env.sources import Source, source_of, with_space
from prefcal_scenarios.own.checks import check_parts
from prefcal_scenarios.own.tracking import found_rows, promised

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


@dataclass(frozen=True, slots=True)
class KPI:
    """A key performance indicator (KPI): a number that people read off an experiment.

    Args:
        name: Key in `Experiment.kpis`.
        title: Title for people.
        unit: Unit of the values and limits.
        at_most: Largest value that meets the objective, in `unit`.
        at_least: Smallest value that meets the objective, in `unit`.
        better: Direction of improvement if there is no objective. Without a direction or an
            objective, the KPI is informational and the agent does not learn from it (for
            example, a score that a person would not write down).
        about: One sentence that explains the KPI to people.
        resolution: Smallest difference that people can see, in `unit`: values are shown, and
            simulated ones learned from, as its multiples. None for a hundredth of an objective's
            range, rounded down to a power of 10, and for 0.01 of a KPI in %; others are shown with
            four significant digits.

    Raises:
        ScenarioError: If `better` is not "lower", "higher" or None, if `at_least` is above
            `at_most`, or if `resolution` is not above 0.
    """

    name: str
    title: str
    unit: str = ""
    at_most: float = np.inf
    at_least: float = -np.inf
    better: Literal["lower", "higher"] | None = None
    about: str = ""
    resolution: float | None = None

    def __post_init__(self) -> None:
        if self.resolution is not None and not 0 < self.resolution < np.inf:
            raise ScenarioError(
                f"resolution of KPI {self.name!r} must be above 0 and finite, "
                f"got {self.resolution} {self.unit}".rstrip()
            )
        if self.better not in ("lower", "higher", None):
            raise ScenarioError(
                f"better of KPI {self.name!r} must be lower, higher or None, got {self.better!r}"
            )
        if not self.at_least <= self.at_most:
            raise ScenarioError(
                f"KPI {self.name!r}: at_least must not be above at_most, "
                f"got {self.at_least} and {self.at_most} {self.unit}".rstrip()
            )

    @property
    def goal(self) -> Literal["lower", "higher", "target"] | None:
        """Return the direction of improvement; "target" is the middle of the objective's range."""
        if self.better is not None:
            return self.better
        if np.isfinite(self.at_most) and np.isfinite(self.at_least):
            return "target"
        if np.isfinite(self.at_most):
            return "lower"
        return "higher" if np.isfinite(self.at_least) else None

    @property
    def step(self) -> float:
        """Return the smallest difference that is shown, in `unit`; 0 if only digits limit it."""
        if self.resolution is not None:
            return self.resolution
        width = self.at_most - self.at_least
        if np.isfinite(width) and width > 0:
            return float(10.0 ** np.floor(np.log10(width / 100)))
        return 0.01 if self.unit == "%" else 0.0

    def read(self, value: float) -> float:
        """Return `value` as it is shown: in multiples of `step`, with four significant digits."""
        return float(as_read(value, self.step))

    def judged(self, value: float) -> float:
        """Return how bad `value` looks: equal for values that read the same or meet a target."""
        if self.goal == "target" and self.met(value):
            return 0.0
        return self.badness(self.read(value))

    def badness(self, value: float) -> float:
        """Return `value` transformed so that lower is better; NaN if it could not be measured."""
        if self.goal == "target":
            return abs(value - (self.at_most + self.at_least) / 2)
        if self.goal == "higher":
            return np.nan if value == np.inf else -value
        return value

    def met(self, value: float) -> bool | None:
        """Return whether `value`, as read, meets the objective; None if there is no objective."""
        if np.isinf(self.at_most) and np.isinf(self.at_least):
            return None
        return bool(self.at_least <= self.read(value) <= self.at_most)

    def met_by(self, experiment: Experiment) -> bool | None:
        """Return whether an experiment meets the objective; None without one or a value."""
        value = experiment.kpis.get(self.name)
        return None if value is None else self.met(value)


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

    def __post_init__(self) -> None:
        if not callable(self.run):
            raise ScenarioError(f"scenario {self.name!r}: run must be a function of θ, got {self.run!r}")
        if isinstance(self.kpis, _Unstated):
            channels = self.source.channels
            rows = [] if channels is None else found_rows(channels)
            if rows:
                object.__setattr__(self, "kpis", tuple(KPI(**row) for row in rows))
            names = [row["name"] for row in rows]
            object.__setattr__(self, "run", self.source.tracked(lambda there: promised(there, names)))
        check_parts(self, KPI)

    @property
    def source(self) -> Source:
        """Return `run` as a source: what turns θ into an experiment."""
        return source_of(self.run)

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
    rows = found_rows(experiment.channels, experiment.kpis)
    return replace(scenario, kpis=tuple(KPI(**row) for row in rows)) if rows else scenario


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
