"""A taste that trades KPIs off against each other, with diminishing returns."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .rule import sign, with_interruptions
from .runs import Runs


@dataclass(frozen=True, slots=True)
class Term:
    """One KPI in the cost.

    Args:
        name: Name of the KPI.
        weight: Share of the cost, above 0.
        good: Value that could not be better, in the KPI's unit.
        scale: Distance from `good` at which half of its weight is lost, above 0, in that unit.
        steepness: Exponent, above 0. With a large one there is a threshold at `scale`: near
            `good` returns diminish, and far from it all values are equally bad. With a small one
            ratios count.
    """

    name: str
    weight: float
    good: float
    scale: float
    steepness: float

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return weight / (1 + (scale / distance)^steepness), shape (K,)."""
        distance = np.maximum(runs.column(self.name) - self.good, 0.0)
        with np.errstate(divide="ignore", over="ignore"):
            cost: Float[np.ndarray, " K"] = self.weight / (1.0 + (self.scale / distance) ** self.steepness)
        return cost


@dataclass(frozen=True, slots=True)
class Weighted:
    """A `Rule`: the sum of `terms`, whose weights add up to 1."""

    terms: tuple[Term, ...]

    def trade_off(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the sum, between 0 and 1, shape (K,), as if no run had been interrupted."""
        return np.asarray(np.sum([term.cost(runs) for term in self.terms], axis=0))

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the cost, lower is better, shape (K,)."""
        return with_interruptions(self.trade_off(runs), runs)

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is better, 0 for a tie, and 1 where `b` is."""
        return sign(self.cost(a) - self.cost(b))
