"""A judgement by an order of criteria, each with a limit or none, with ties to the end."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from prefcal_bench.people.rule import minus
from prefcal_bench.people.runs import Runs

from .noticing import noticeable


@dataclass(frozen=True, slots=True)
class Criterion:
    """A KPI, or something seen in the curves.

    Args:
        name: Name of the KPI or of the look.
        noticed: Just noticeable difference, in its unit.
        at_most: Limit below which all values are equally good, in its unit.
    """

    name: str
    noticed: float
    at_most: float = -np.inf

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably lower above the limit, 0 for a tie, 1 where `b` is."""
        x, y = (np.maximum(runs.column(self.name), self.at_most) for runs in (a, b))
        return noticeable(minus(x, y), self.noticed)


@dataclass(frozen=True, slots=True)
class Order:
    """A `Judgement`: the first of `criteria` that differs noticeably decides; else it is a tie."""

    criteria: tuple[Criterion, ...]

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""
        found = self.criteria[0].verdict(a, b)
        for criterion in self.criteria[1:]:
            found = np.where(found == 0, criterion.verdict(a, b), found)
        return found
