"""A rule with just noticeable differences, which every person with eyes follows."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from prefcal_bench.people.rule import survival
from prefcal_bench.people.runs import Runs


class Judgement(Protocol):
    """How a person compares runs that were not interrupted."""

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""


@dataclass(frozen=True, slots=True)
class Eyes:
    """A `Rule`: a run that survives longer is better; otherwise what is noticed decides.

    Differences that are not noticed can add up, so it is not transitive, and has no cost.
    """

    by: Judgement

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""
        first = survival(a, b)
        both_stopped = np.isfinite(a.survived) & np.isfinite(b.survived)
        return np.where((first == 0) & ~both_stopped, self.by.verdict(a, b), first)

    def cost(self, runs: Runs) -> None:
        """Return None: with just noticeable differences, no cost has the same order."""
        return


def noticeable(difference: Float[np.ndarray, " K"], noticed: float) -> Int[np.ndarray, " K"]:
    """Return the sign of differences larger than `noticed`, and 0 for the others, shape (K,)."""
    larger = np.abs(difference) > noticed
    return np.where(larger, np.sign(difference), 0.0).astype(np.int64)
