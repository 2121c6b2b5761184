"""A judgement by the sum of ranks among usual runs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_bench.people.runs import Runs

from .noticing import noticeable


@dataclass(frozen=True, slots=True)
class Scale:
    """The ranks of one KPI.

    Args:
        name: Name of the KPI.
        marks: Values that usual runs have, rising, in its unit.
        shares: Share of usual runs that are better than each of `marks`, from 0 to 1, rising.
    """

    name: str
    marks: tuple[float, ...]
    shares: tuple[float, ...]

    def rank(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the share of usual runs that are better, shape (K,), 1 beyond the last mark."""
        values = runs.column(self.name)
        inside = np.minimum(values, self.marks[-1])
        return np.where(values > self.marks[-1], 1.0, np.interp(inside, self.marks, self.shares))


@dataclass(frozen=True, slots=True)
class Ranks:
    """A `Judgement`: the smaller sum of ranks is better.

    Args:
        scales: Ranks of the KPIs that count, each as much as the others.
        noticed: Just noticeable difference of the sum.
    """

    scales: tuple[Scale, ...]
    noticed: float

    def total(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the sum of ranks, shape (K,)."""
        return np.asarray(np.sum([scale.rank(runs) for scale in self.scales], axis=0))

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""
        return noticeable(self.total(a) - self.total(b), self.noticed)
