"""A judgement by a trade-off with diminishing returns and one just noticeable difference."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_bench.people.runs import Runs

from .noticing import noticeable

_FAR = 100.0
"""Number of scales beyond which a KPI is as bad as it can be."""


@dataclass(frozen=True, slots=True)
class Share:
    """One KPI in the cost.

    Args:
        name: Name of the KPI.
        weight: Weight, above 0.
        good: Value that could not be better, in the KPI's unit.
        scale: Distance from `good` from which on ratios count, above 0, in that unit.
        power: Exponent, 1 or more: the larger, the less is gained near `good`.
    """

    name: str
    weight: float
    good: float
    scale: float
    power: float

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return weight · log(1 + (distance / scale)^power), shape (K,)."""
        beyond = np.maximum(runs.column(self.name) - self.good, 0.0)
        scales = np.minimum(beyond, _FAR * self.scale) / self.scale
        return self.weight * np.log1p(scales**self.power)


@dataclass(frozen=True, slots=True)
class Trade:
    """A `Judgement`: the smaller sum of `shares` is better.

    Args:
        shares: What counts.
        noticed: Just noticeable difference of the sum.
    """

    shares: tuple[Share, ...]
    noticed: float

    def total(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the sum of costs, shape (K,)."""
        return np.asarray(np.sum([share.cost(runs) for share in self.shares], axis=0))

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""
        return noticeable(self.total(a) - self.total(b), self.noticed)
