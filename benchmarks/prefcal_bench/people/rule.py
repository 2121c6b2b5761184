"""Rules by which experiments are compared: what all of them share."""

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


def survival(a: Runs, b: Runs) -> Int[np.ndarray, " K"]:
    """Return -1 where `a` survives longer than `b`, 0 for as long, and 1 where `b` does."""
    return sign(minus(b.survived, a.survived))


def sign(difference: Float[np.ndarray, " K"]) -> Int[np.ndarray, " K"]:
    """Return -1, 0 or 1, shape (K,)."""
    return np.asarray(np.sign(difference), dtype=np.int64)


def minus(a: Float[np.ndarray, " K"], b: Float[np.ndarray, " L"]) -> Float[np.ndarray, " M"]:
    """Return a - b, where two infinite values differ by 0."""
    with np.errstate(invalid="ignore"):
        return np.where(a == b, 0.0, a - b)


def with_interruptions(cost: Float[np.ndarray, " K"], runs: Runs) -> Float[np.ndarray, " K"]:
    """Return `cost`, at most 1, with between 1 and 2 for interrupted runs: longer ones less."""
    stopped = np.isfinite(runs.survived)
    return np.where(stopped, 1.0 + 1.0 / (1.0 + runs.survived), cost)
