"""A judgement by the majority of the KPIs that differ noticeably."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from prefcal_bench.people.rule import sign
from prefcal_bench.people.runs import Runs

from .order import Criterion


@dataclass(frozen=True, slots=True)
class Majority:
    """A `Judgement`: each of `criteria` has a vote if it differs noticeably; even votes are a tie.

    It goes round in circles at times, as votes do.
    """

    criteria: tuple[Criterion, ...]

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where more votes are for `a`, 0 for as many, and 1 where more are for `b`."""
        votes = np.sum([criterion.verdict(a, b) for criterion in self.criteria], axis=0)
        return sign(votes)
