"""Rules by which experiments are compared: what all of them share."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from .runs import Runs


class Rule(Protocol):
    """Who is better, for many pairs at once.

    An interrupted experiment loses against one that was not, and of two interrupted ones the
    longer is better (end of section III).
    """

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is better, 0 for a tie, and 1 where `b` is; `b` may have length 1."""

    def cost(self, runs: Runs) -> Float[np.ndarray, " K"] | None:
        """Return a cost with the same order, lower is better, shape (K,); None if none exists."""


class Judgement(Protocol):
    """How a person compares runs that were not interrupted."""

    def verdict(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""


@dataclass(frozen=True, slots=True)
class Noticing:
    """A `Rule`: a run that survives longer is better; otherwise what is noticed decides.

    Differences that are not noticed can add up, so it is not transitive, and has no cost.
    """

    by: Judgement  # what the person notices
    # Whether what differs unnoticed is at least as good, see `worth`. To people with eyes it is no
    # improvement.
    ties_count: bool = False

    def compare(self, a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
        """Return -1 where `a` is noticeably better, 0 for a tie, and 1 where `b` is."""
        first = survival(a, b)
        both_stopped = np.isfinite(a.survived) & np.isfinite(b.survived)
        return np.where((first == 0) & ~both_stopped, self.by.verdict(a, b), first)

    def cost(self, runs: Runs) -> None:
        """Return None: with just noticeable differences, no cost has the same order."""
        return


def survival(a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
    """Return -1 where `a` survives longer than `b`, 0 for as long, and 1 where `b` does."""
    return sign(minus(b.survived, a.survived))


def sign(difference: Float[np.ndarray, " K"]) -> Int[np.ndarray, " K"]:
    """Return -1, 0 or 1, shape (K,)."""
    return np.asarray(np.sign(difference), dtype=np.int64)


def noticeable(
    difference: Float[np.ndarray, " K"], noticed: float | Float[np.ndarray, " K"]
) -> Int[np.ndarray, " K"]:
    """Return the sign of differences larger than `noticed`, and 0 for the others, shape (K,)."""
    return np.where(np.abs(difference) > noticed, sign(difference), 0)


def minus(a: Float[np.ndarray, " K"], b: Float[np.ndarray, " L"]) -> Float[np.ndarray, " M"]:
    """Return a - b, where two infinite values differ by 0."""
    with np.errstate(invalid="ignore"):
        return np.where(a == b, 0.0, a - b)
