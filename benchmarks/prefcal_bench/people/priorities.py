"""A taste with priorities: the first KPI that differs noticeably decides."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from .rule import minus, survival
from .runs import Runs


@dataclass(frozen=True, slots=True)
class Priority:
    """A KPI, and the largest difference of it that is not noticed.

    Args:
        name: Name of the KPI.
        noticed: Just noticeable difference: in the KPI's unit, or if `relative`, as a share of
            the larger value.
        relative: Whether the difference is relative.
    """

    name: str
    noticed: float
    relative: bool = False

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably lower, 0 for a tie, and 1 where `b` is."""
        x, y = a.column(self.name), b.column(self.name)
        difference = minus(x, y)
        threshold = np.full(np.shape(difference), self.noticed)
        if self.relative:
            larger = np.maximum(np.abs(x), np.abs(y))
            threshold = self.noticed * np.where(np.isinf(larger), 0.0, larger)
        return np.where(np.abs(difference) > threshold, np.sign(difference), 0).astype(np.int64)


@dataclass(frozen=True, slots=True)
class Priorities:
    """A `Rule`: `order` lists the KPIs by importance. It is not transitive, and has no cost."""

    order: tuple[Priority, ...]

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is better, 0 for a tie, and 1 where `b` is."""
        verdict = survival(a, b)
        both_stopped = np.isfinite(a.survived) & np.isfinite(b.survived)
        for priority in self.order:
            undecided = (verdict == 0) & ~both_stopped
            verdict = np.where(undecided, priority.compare(a, b), verdict)
        return verdict

    def cost(self, runs: Runs) -> None:
        """Return None: with just noticeable differences, no cost has the same order."""
        return
