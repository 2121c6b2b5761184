"""A taste with limits first, then a trade-off."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .rule import sign, with_interruptions
from .runs import Runs
from .weighted import Weighted


@dataclass(frozen=True, slots=True)
class Limit:
    """Largest accepted value of a KPI.

    Args:
        name: Name of the KPI.
        at_most: Largest accepted value, in the KPI's unit.
        scale: Excess that counts as half of the worst, above 0, in that unit.
    """

    name: str
    at_most: float
    scale: float

    def excess(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return how far the KPI is beyond the limit, from 0 to 1, shape (K,)."""
        with np.errstate(divide="ignore", over="ignore"):
            beyond = np.maximum(runs.column(self.name) - self.at_most, 0.0)
            return np.asarray(1.0 / (1.0 + self.scale / beyond))


@dataclass(frozen=True, slots=True)
class Limited:
    """A `Rule`: runs within all `limits` come first, compared by `rest`; then the smaller excess.

    Args:
        limits: One or more limits.
        rest: Trade-off among the runs within all limits.
    """

    limits: tuple[Limit, ...]
    rest: Weighted

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the cost, shape (K,): up to 0.5 within the limits, between 0.5 and 1 beyond."""
        excess = np.mean([limit.excess(runs) for limit in self.limits], axis=0)
        within = 0.5 * self.rest.trade_off(runs)
        return with_interruptions(np.where(excess > 0, 0.5 + 0.5 * excess, within), runs)

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is better, 0 for a tie, and 1 where `b` is."""
        return sign(self.cost(a) - self.cost(b))
