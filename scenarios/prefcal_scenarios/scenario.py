"""A scenario: everything about one calibration task, as data, and how to find it by name."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Panel as Panel
from prefcal_env.experiments.panels import Plot, plots_of
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.preferences.answer import Calibrator
from prefcal_scenarios.own.checks import check_parts
from prefcal_scenarios.own.nearest import did_you_mean
from prefcal_scenarios.own.own_file import module_at
from prefcal_scenarios.own.source import split_source

if TYPE_CHECKING:
    from prefcal_env.mpc.computation import Processor
    from prefcal_scenarios.app.report.pictures import Picture

BUILT_IN: Mapping[str, str] = {
    "cstr": "prefcal_scenarios.cases.cstr:cstr",
    "overtake": "prefcal_scenarios.cases.overtake:overtake",
    "overtake-robust": "prefcal_scenarios.cases.overtake:overtake_robust",
}
"""Name to "module:attribute"; loaded when asked for."""


class Run(Protocol):
    """One closed-loop experiment."""

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,)."""


@dataclass(frozen=True, slots=True)
class KPI:
    """A key performance indicator: its key in `Experiment.kpis`, title, unit, and objective.

    `at_most` and `at_least` state the objective, in `unit`; a KPI with neither is for information.
    `better` says which way is better where the objective does not; without either, the agent
    does not learn from it (a score, say, that a person could not have written down). `about` says
    in a sentence what it means, for people.

    Raises:
        ScenarioError: `better` is neither "lower" nor "higher" nor None, or no value can be at
            least `at_least` and at most `at_most`.
    """

    name: str
    title: str
    unit: str = ""
    at_most: float = np.inf
    at_least: float = -np.inf
    better: Literal["lower", "higher"] | None = None
    about: str = ""

    def __post_init__(self) -> None:
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
        """Which way is better; "target" is the middle of `at_least` and `at_most`."""
        if self.better is not None:
            return self.better
        if np.isfinite(self.at_most) and np.isfinite(self.at_least):
            return "target"
        if np.isfinite(self.at_most):
            return "lower"
        return "higher" if np.isfinite(self.at_least) else None

    def badness(self, value: float) -> float:
        """`value` turned so that lower is better; NaN where nothing was there to be measured."""
        if self.goal == "target":
            return abs(value - (self.at_most + self.at_least) / 2)
        if self.goal == "higher":
            return np.nan if value == np.inf else -value
        return value

    def met(self, value: float) -> bool | None:
        """Whether `value` meets the objective; None where none is stated."""
        if np.isinf(self.at_most) and np.isinf(self.at_least):
            return None
        return self.at_least <= value <= self.at_most


@dataclass(frozen=True)
class Scenario:
    """One calibration task.

    Args:
        name: Short, as in `prefcal calibrate NAME`.
        title: For headings.
        space: The knobs.
        run: One experiment of a physical θ.
        cost: Latent cost of an experiment, lower is better; None where no single score exists.
        kpis: What people read of an experiment, in order of importance.
        panels: What people look at, top down, each named by its channel; none: every state and
            input, and every output that is no state.
        references: Named θ to compare with, the paper's say, physical, shape (n,).
        calibrators: Synthetic calibrators by name, each made from a seed.
        controller: The tuned controller of a θ.
        settings: The controller's settings at a θ, JSON-able, for the export.
        scene: What the query window animates of an experiment, JSON-able; see
            `prefcal_scenarios.cases.overtake.pictures.drawing.Drawing.as_json`.
        brief: What the task is, in a few sentences for the person who compares.
        configured: The scenario for another configuration, plain data, as `--config` reads it.
        on_processor: A scenario like this one with its computation times judged on a `Processor`;
            None where computing is no criterion.
        pictures: The scenario's own figures for the report, above those that every report has;
            a function, so that plots are loaded for reports only.

    Raises:
        ScenarioError: a part of the wrong type, a reference θ that does not fit the space, KPIs
            of one name; panels or KPIs that `run` is known not to give. Where `run` states no
            `channels`, its first experiment tells (see `prefcal_scenarios.own.checks`).
    """

    name: str
    title: str
    space: KnobSpace
    run: Run
    cost: Callable[[Experiment], float] | None = None
    kpis: tuple[KPI, ...] = ()
    panels: tuple[Panel, ...] = ()
    references: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    calibrators: Mapping[str, Callable[..., Calibrator[Experiment]]] = field(default_factory=dict)
    controller: Callable[[Float[np.ndarray, " n"]], Controller] | None = None
    settings: Callable[[Float[np.ndarray, " n"]], dict[str, Any]] | None = None
    scene: Callable[[Experiment], dict[str, Any]] | None = None
    pictures: "Callable[[], Sequence[Picture]] | None" = None
    configured: "Callable[[Mapping[str, Any]], Scenario] | None" = None
    brief: str = ""
    on_processor: "Callable[[Scenario, Processor], Scenario] | None" = None

    def __post_init__(self) -> None:
        check_parts(self, KPI)

    @property
    def shown_kpis(self) -> tuple[KPI, ...]:
        """KPIs that people are shown: not the index, a score that nobody who compares chose."""
        return tuple(k for k in self.kpis if self.cost is None or k.name != "index")


def described(kpis: Sequence[KPI], about: Mapping[str, str]) -> tuple[KPI, ...]:
    """The KPIs with what each means in a sentence, by the KPI's name.

    Raises:
        ScenarioError: a name that no KPI has.
    """
    unknown = sorted(set(about) - {kpi.name for kpi in kpis})
    if unknown:
        raise ScenarioError(f"about must name some of the KPIs, got {unknown}")
    return tuple(replace(kpi, about=about.get(kpi.name, kpi.about)) for kpi in kpis)


def panels_of(scenario: Scenario, *experiments: Experiment) -> tuple[Plot, ...]:
    """Return what to draw of one or more experiments, the same for all of them.

    The scenario's panels, or without any one for each state, input, and output that is no state.
    A panel whose curve none of them has, as experiments from before it was added, is empty.
    """
    recorded = [e for e in experiments if len(e.t)] or list(experiments)
    if not scenario.panels:
        return plots_of(recorded[0].channels)
    return tuple(_plot(panel, recorded) for panel in scenario.panels)


def _plot(panel: Panel, experiments: Sequence[Experiment]) -> Plot:
    for experiment in experiments:
        try:
            return panel.plot(experiment)
        except ScenarioError:
            continue
    return panel.absent()


def with_ranges(scenario: Scenario, space: KnobSpace) -> Scenario:
    """`scenario` with the knobs of `space`, whose ranges may be wider than its own.

    Where its `run`, `controller` or `settings` take an argument `space`, they are given it: those
    that check θ know by that what is allowed now.
    """
    return replace(
        scenario,
        space=space,
        run=_within(scenario.run, space),
        controller=_within(scenario.controller, space),
        settings=_within(scenario.settings, space),
    )


def _within(function: Any, space: KnobSpace) -> Any:
    if hasattr(function, "within"):  # a run in another process
        return function.within(space)
    takes = callable(function) and "space" in signature(function).parameters
    return partial(function, space=space) if takes else function


def is_built_in(source: str) -> bool:
    """Whether the scenario is one of ours, with a configuration or without, and no program."""
    return source.partition("{")[0].strip() in BUILT_IN


def is_own(source: str) -> bool:
    """Whether the scenario is a user's own, path/to/own.py:attribute, configured or not."""
    return source.partition("{")[0].strip().rpartition(":")[0].endswith(".py")


def load(name: str) -> Scenario:
    """Return the scenario called `name`: one of `BUILT_IN`, or "path/to/own.py:attribute".

    After either its configuration may follow, in JSON: 'overtake {"lanes_count": 3}'.

    Raises:
        ScenarioError: no scenario of that name, no such file or attribute, or not a Scenario; one
            that cannot be configured, or no JSON.
        SettingsError: a configuration that the scenario refuses.
    """
    bare, config = split_source(str(name))
    if config is not None:
        scenario = load(bare)
        if scenario.configured is None:
            raise ScenarioError(f"scenario {bare!r} takes no configuration, got {config}")
        return scenario.configured(config)
    path, _, attribute = str(name).rpartition(":")
    if attribute.endswith(".py"):
        raise ScenarioError(f"{name!r} is a file: say which scenario in it, {name}:NAME")
    if is_own(name):
        return _scenario_in(module_at(Path(path)), attribute, name)
    if name in BUILT_IN:
        module, _, attribute = BUILT_IN[name].partition(":")
        return _scenario_in(import_module(module), attribute, name)
    raise ScenarioError(
        f"no scenario is called {name!r}.{did_you_mean(str(name), BUILT_IN)} "
        f"Expected {', '.join(BUILT_IN)} or path/to/own.py:NAME (see `prefcal scenarios`)"
    )


def _scenario_in(module: ModuleType, attribute: str, name: str) -> Scenario:
    found = getattr(module, attribute, None)
    if isinstance(found, Scenario):
        return found
    got = repr(found) if hasattr(module, attribute) else "nothing of that name"
    there = [key for key, value in vars(module).items() if isinstance(value, Scenario)]
    raise ScenarioError(
        f"{name!r} must name a prefcal_scenarios.Scenario, got {got}; "
        f"in that file there is {', '.join(there) or 'none'}"
    )
