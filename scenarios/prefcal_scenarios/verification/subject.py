"""A scenario with what of it can vary."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.margins import MarginKPIs, Margins
from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.sources.function import function_of
from prefcal_env.sources.maneuvers import Maneuvers
from prefcal_env.sources.source import Source, WithKPIs

from .factor import Factor, Values


def unknown_plant(theta: Float[np.ndarray, " n"]) -> str:
    """Return why a θ of a run whose plant nobody knows has no margins."""
    return "no margins: the plant is not known as equations, so it cannot be linearized"


@dataclass(frozen=True, slots=True)
class Subject:
    """What can vary, and how a run with other values is made.

    Args:
        factors: What can vary.
        left_out: What cannot, a sentence each.
        at: Function of values that returns the source with them; the controller stays as designed.
        margins: Function of a physical θ, shape (n,), that returns its margins where the nominal
            experiment starts, or why there are none.
    """

    factors: tuple[Factor, ...]
    left_out: tuple[str, ...]
    at: Callable[[Values], Source]
    margins: Callable[[Float[np.ndarray, " n"]], Margins | str] = unknown_plant

    def measured_as(self, source: WithKPIs) -> "Subject":
        """Return the same whose runs have the KPIs of `source`."""
        return replace(self, at=partial(_measured, self.at, source))


def of_maneuvers(source: Maneuvers, parts: dict[str, Subject]) -> Subject:
    """Return what varies in all maneuvers together; margins are those of the first one.

    A value that differs from its nominal one does so by the same share in each maneuver.
    """
    first = {f.name: f for part in reversed(parts.values()) for f in part.factors}
    said = dict.fromkeys(text for part in parts.values() for text in part.left_out)
    at = partial(_maneuvers, source, parts, first)
    return Subject(tuple(first.values()), tuple(said), at, next(iter(parts.values())).margins)


def _measured(at: Callable[[Values], Source], source: WithKPIs, values: Values) -> Source:
    made, kpis = at(values), source.kpis
    loop = function_of(made)
    if isinstance(kpis, MarginKPIs) and isinstance(loop, ClosedLoop):
        # Of the varied plant, but of the controller itself: a law that sticks has no margins.
        kpis = MarginKPIs(ClosedLoop(loop.env, kpis.loop.controller))
    return WithKPIs(made, kpis)


def _maneuvers(
    source: Maneuvers, parts: dict[str, Subject], first: dict[str, Factor], values: Values
) -> Maneuvers:
    made = {name: part.at(_own(part, first, values)) for name, part in parts.items()}
    return Maneuvers(made, higher_is_better=source.higher_is_better, targets=source.targets)


def _own(part: Subject, first: dict[str, Factor], values: Values) -> dict[str, float]:
    """Return the values of one maneuver, given those for the nominal values of the first one."""
    found = {}
    for factor in part.factors:
        if factor.name in values:
            nominal = first[factor.name].nominal
            share = factor.nominal / nominal if nominal else 1.0
            found[factor.name] = share * values[factor.name]
    return found
