"""What of a scenario can vary, and how it runs with other values."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from inspect import signature
from typing import Any, Protocol

from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.knob import is_number
from prefcal_env.sources.function import Function, function_of
from prefcal_env.sources.source import Source, WithKPIs
from prefcal_scenarios.cases.loops.loop import Loop
from prefcal_scenarios.scenario import Scenario

from .cases import CASES
from .factor import Factor, Values
from .loops import LoopSubject
from .plants import PlantSubject

PARAMETER = 0.1
"""Usual relative change of a parameter."""
_ADD = (
    "nothing of it can be varied: give the parameters of its plant as arguments with a default, such as "
    "run(theta, seed=0, mass=1.2), or run it as a ClosedLoop of a plant (FMUs cannot be varied yet)"
)
_OURS = ("theta", "seed", "space")


class Subject(Protocol):
    """A scenario with what can vary."""

    @property
    def factors(self) -> tuple[Factor, ...]:
        """What can vary."""

    @property
    def left_out(self) -> tuple[str, ...]:
        """What cannot, a sentence each."""

    def at(self, values: Values) -> Callable[..., Experiment]:
        """Return the run of θ and a seed with these values; the controller stays as it is designed."""


def subject_of(scenario: Scenario) -> Subject:
    """Return what of a scenario can vary.

    Raises:
        ScenarioError: If nothing can; the message says what to add.
    """
    source = scenario.source
    if source.asks:
        raise ScenarioError(
            f"scenario {scenario.name!r} runs on a rig or a live plant, which cannot be varied: verify a "
            "model of it"
        )
    if source.maneuvers:
        raise ScenarioError(f"scenario {scenario.name!r} has maneuvers: verify each in a scenario of its own")
    function = function_of(source)
    bare = function.func if isinstance(function, partial) else function
    loop = getattr(bare, "__self__", None)
    if isinstance(loop, Loop):
        return LoopSubject(loop, scenario.space)
    if isinstance(function, ClosedLoop):
        return PlantSubject(function)
    module = getattr(bare, "__module__", "")
    if module in CASES:
        known: Subject = CASES[module](function)
        return known
    if bare is None or not callable(bare):
        raise ScenarioError(f"scenario {scenario.name!r}: {_ADD}")
    return _arguments(scenario, function)


def _arguments(scenario: Scenario, function: Any) -> Subject:
    """Return the numbers that the run takes as arguments, besides θ and the seed."""
    given = signature(function).parameters.values()
    numbers = {p.name: p.default for p in given if p.name not in _OURS and is_number(p.default)}
    factors = tuple(Factor.around(n, "parameter", PARAMETER, float(v)) for n, v in numbers.items())
    if not factors:
        raise ScenarioError(f"scenario {scenario.name!r} is only a function of θ, so {_ADD}")
    return FunctionSubject(function, factors)


@dataclass(frozen=True, slots=True)
class FunctionSubject:
    """A function of θ whose other numbers are arguments with a default."""

    function: Callable[..., Experiment]
    factors: tuple[Factor, ...]
    left_out: tuple[str, ...] = field(
        default=("only arguments of its run are varied: sensors, actuators and the task are in its code",)
    )

    def at(self, values: Values) -> Callable[..., Experiment]:
        """Return the function with these arguments."""
        return partial(self.function, **values)


def varied(source: Source, run: Callable[..., Experiment]) -> Source:
    """Return a source like `source`, with the same KPIs, that does `run`."""
    if isinstance(source, WithKPIs):
        return WithKPIs(varied(source.source, run), source.kpis)
    return Function(run)


def named(factors: tuple[Factor, ...], values: Any) -> Mapping[str, float]:
    """Return values, one for each factor, by name."""
    return dict(zip((factor.name for factor in factors), map(float, values), strict=True))
