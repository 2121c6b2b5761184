"""A judgement by the distance from an ideal run."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_bench.people.runs import Runs

from .noticing import noticeable

_FAR = 10.0
"""Number of scales beyond which a KPI is as far as it can be."""


@dataclass(frozen=True, slots=True)
class Wish:
    """One KPI, or one look, of the ideal run.

    Args:
        name: Name of the KPI or of the look.
        value: Value that one would like; lower ones are as good, in its unit.
        scale: Unit of its distance, above 0, in its unit.
    """

    name: str
    value: float
    scale: float

    def distance(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the distance in scales, from 0 to 10, shape (K,)."""
        beyond = np.maximum(runs.column(self.name) - self.value, 0.0)
        return np.minimum(beyond, _FAR * self.scale) / self.scale


@dataclass(frozen=True, slots=True)
class Ideal:
    """A `Judgement`: the run nearer to the ideal one is better.

    Args:
        wishes: What the ideal run is like.
        power: Exponent of the distance: 1 adds up, 2 is as the crow flies, and with infinity the
            KPI that is farthest off decides.
        noticed: Just noticeable difference of the distance.
    """

    wishes: tuple[Wish, ...]
    power: float
    noticed: float

    def total(self, runs: Runs) -> Float[np.ndarray, " K"]:
        """Return the distance from the ideal run, shape (K,)."""
        distances = np.array([wish.distance(runs) for wish in self.wishes])
        return np.asarray(np.linalg.norm(distances, ord=self.power, axis=0))

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably nearer, 0 for a tie, and 1 where `b` is."""
        return noticeable(self.total(a) - self.total(b), self.noticed)
