"""Rules that trade KPIs off against each other, with diminishing returns, and so have a cost."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from .rule import sign
from .runs import Runs


@dataclass(frozen=True, slots=True)
class Term:
    """One KPI in the cost."""

    name: str  # name of the KPI
    weight: float  # share of the cost, above 0
    good: float  # value that could not be better, in the KPI's unit
    scale: float  # distance from `good` at which half of its weight is lost, above 0, in that unit
    # Exponent, above 0. With a large one there is a threshold at `scale`: near `good` returns diminish, and
    # far from it all values are equally bad. With a small one ratios count.
    steepness: float = 1.0

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return weight / (1 + (scale / distance)^steepness), shape (K,)."""
        distance = np.maximum(runs.column(self.name) - self.good, 0.0)
        with np.errstate(divide="ignore", over="ignore"):
            cost: Float[np.ndarray, " K"] = self.weight / (1.0 + (self.scale / distance) ** self.steepness)
        return cost


@dataclass(frozen=True, slots=True)
class TradeOff:
    """A `Rule`: the smaller sum of `terms` is better, after the smaller excess beyond `limits`."""

    terms: tuple[Term, ...]  # what counts among the runs within all limits; the weights add up to 1
    # KPIs with a largest accepted value, `good`, beyond which `scale` is the excess that counts as half of
    # the worst; their weights are 1
    limits: tuple[Term, ...] = ()

    def trade_off(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the sum of the terms, between 0 and 1, shape (K,), whatever was interrupted."""
        return np.asarray(np.sum([term.cost(runs) for term in self.terms], axis=0))

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the cost, lower is better, shape (K,).

        With limits it is up to 0.5 within them, between 0.5 and 1 beyond. Interrupted runs have
        between 1 and 2, longer ones less.
        """
        cost = self.trade_off(runs)
        if self.limits:
            excess = np.mean([limit.cost(runs) for limit in self.limits], axis=0)
            cost = np.where(excess > 0, 0.5 + 0.5 * excess, 0.5 * cost)
        stopped = np.isfinite(runs.survived)
        return np.where(stopped, 1.0 + 1.0 / (1.0 + runs.survived), cost)

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is better, 0 for a tie, and 1 where `b` is."""
        return sign(self.cost(a) - self.cost(b))


@dataclass(frozen=True, slots=True)
class Standards:
    """A `Rule` by the final standards: the referee of a person whose standards rise."""

    first: TradeOff  # standards at the start
    final: TradeOff  # standards at the end, with the same terms in the same order

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the cost by the final standards, lower is better, shape (K,)."""
        return self.final.cost(runs)

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is better by the final standards, 0 for a tie, 1 where `b` is."""
        return self.final.compare(a, b)

    def person(self) -> "Rising":
        """Return a person at the start of a study."""
        return Rising(self.first, self.final)


@dataclass(slots=True)
class Rising:
    """A `Rule` that changes: the scales shrink as runs get better, one comparison after another.

    After each comparison, the scale of a term becomes the distance of the better run if that is
    smaller, but not smaller than that of `final`.
    """

    now: TradeOff  # today's standards
    final: TradeOff  # standards at the end, with the same terms in the same order

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the cost by today's standards, shape (K,)."""
        return self.now.cost(runs)

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return who is better by today's standards, and raise them; for a single pair."""
        verdict = self.now.compare(a, b)
        better = a if verdict[0] < 0 else b
        if np.isinf(better.survived[0]):
            pairs = zip(self.now.terms, self.final.terms, strict=True)
            self.now = TradeOff(tuple(_raised(term, last, better) for term, last in pairs))
        return verdict


def _raised(term: Term, last: Term, better: Runs) -> Term:
    reached = float(better.column(term.name)[0]) - term.good
    return replace(term, scale=min(term.scale, max(reached, last.scale)))
