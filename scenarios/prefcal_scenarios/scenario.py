"""A scenario: everything about one calibration task, as data, and how to find it by name."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.control import Controller
from prefcal_env.errors import KnobError, ScenarioError
from prefcal_env.experiment import Channel, Channels, Experiment
from prefcal_env.knobs import KnobSpace
from prefcal_env.preference import Calibrator
from prefcal_scenarios.own_file import module_at

if TYPE_CHECKING:
    from prefcal_scenarios.report.pictures import Picture

BUILT_IN: Mapping[str, str] = {
    "cstr": "prefcal_scenarios.cstr:cstr",
    "overtake": "prefcal_scenarios.overtake:overtake",
    "overtake-robust": "prefcal_scenarios.overtake:overtake_robust",
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
    does not learn from it (a score, say, that a person could not have written down).

    Raises:
        ScenarioError: `better` is neither "lower" nor "higher" nor None.
    """

    name: str
    title: str
    unit: str = ""
    at_most: float = np.inf
    at_least: float = -np.inf
    better: Literal["lower", "higher"] | None = None

    def __post_init__(self) -> None:
        if self.better not in ("lower", "higher", None):
            raise ScenarioError(
                f"better of KPI {self.name!r} must be lower, higher or None, got {self.better!r}"
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


@dataclass(frozen=True, slots=True)
class Panel:
    """One plot of an experiment: a state, input or signal of it, as `channel` describes.

    Args:
        kind: "x" or "u" with `index` into that array, or "signal" with `key`.
        channel: Name, unit, limits, target and band to draw.
        scale: What turns the experiment's unit into that of `channel`.
        reference: Key of the signal that holds a reference which changes in time, in the
            experiment's unit.
    """

    kind: str
    channel: Channel
    index: int = 0
    key: str = ""
    scale: float = 1.0
    reference: str = ""

    def values(self, experiment: Experiment) -> Float[np.ndarray, " K"]:
        """The curve, on `experiment.t`; empty where there is no record."""
        if not len(experiment.t):
            return np.zeros(0)
        if self.kind == "signal":
            return self.scale * experiment.signals[self.key]
        array = experiment.x if self.kind == "x" else experiment.u
        return self.scale * array[:, self.index]


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
        panels: What people look at, top down.
        references: Named θ to compare with, the paper's say, physical, shape (n,).
        calibrators: Synthetic calibrators by name, each made from a seed.
        controller: The tuned controller of a θ.
        settings: The controller's settings at a θ, JSON-able, for the export.
        scene: What the query window animates of an experiment, JSON-able; see
            `prefcal_scenarios.overtake.player.scene`.
        pictures: The scenario's own figures for the report, above those that every report has;
            a function, so that plots are loaded for reports only.

    Raises:
        ScenarioError: a reference θ that does not fit the space.
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

    def __post_init__(self) -> None:
        for name, theta in self.references.items():
            try:
                self.space.check(theta)
            except KnobError as error:
                raise ScenarioError(f"reference {name!r} of {self.name!r}: {error}") from error


def panels_of(scenario: Scenario, channels: Channels) -> tuple[Panel, ...]:
    """The scenario's panels, or one for each state and input."""
    if scenario.panels:
        return scenario.panels
    states = tuple(Panel("x", channel, index=i) for i, channel in enumerate(channels.x))
    return states + tuple(Panel("u", channel, index=i) for i, channel in enumerate(channels.u))


def load(name: str) -> Scenario:
    """Return the scenario called `name`: one of `BUILT_IN`, or "path/to/own.py:attribute".

    Raises:
        ScenarioError: no scenario of that name, no such file or attribute, or not a Scenario.
    """
    path, _, attribute = str(name).rpartition(":")
    if attribute.endswith(".py"):
        raise ScenarioError(f"{name!r} is a file: say which scenario in it, {name}:NAME")
    if path.endswith(".py"):
        return _scenario_in(module_at(Path(path)), attribute, name)
    if name in BUILT_IN:
        module, _, attribute = BUILT_IN[name].partition(":")
        return _scenario_in(import_module(module), attribute, name)
    raise ScenarioError(
        f"no scenario is called {name!r}: expected one of {sorted(BUILT_IN)} or path/to/own.py:name"
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
