"""Whether the answers contain mistakes: then none of them should have to be kept."""

from dataclasses import replace

import numpy as np

from prefcal_env.qp import Backend

from .cross_validation import Validation
from .fitting import Learning
from .ledger import Preferences
from .surrogate import Shape

FEWEST = 6
"""Comparisons from which on the question is worth asking."""

WINDOW = 10
"""Proposals over which the evidence is added up: one cross-validation alone is a guess."""

_DEALS = 2  # times that the comparisons are dealt out to slices
_ENOUGH = 0.5  # comparisons that must be won per proposal


def advantage(
    preferences: Preferences,
    shape: Shape,
    learning: Learning,
    softer: float,
    backend: Backend,
    folds: int,
    seed: tuple[int, int],
) -> int:
    """How many more left-out preferences are reproduced when λ is `softer` times as large.

    Source: none.
    Deviation: the paper's λ is fixed. Where one in ten answers is wrong, a surrogate that keeps
    them all follows the mistakes; cross-validation notices.

    Args:
        preferences: M comparisons.
        shape: Of φ.
        learning: How β is learned where nothing is wrong.
        softer: Factor on λ.
        backend: QP solver.
        folds: Slices.
        seed: Of the dealing: the agent's, and how many samples are closed.
    """
    scores = []
    for lam in (learning.lam, softer * learning.lam):
        total = 0
        for deal in range(_DEALS):
            rng = np.random.default_rng([*seed, 5 + deal])
            kind = replace(learning, lam=lam)
            total += Validation.deal(preferences, kind, backend, folds, rng).reproduced(shape)
        scores.append(total)
    return scores[1] - scores[0]


def contradictory(advantages: list[int]) -> bool:
    """Whether the advantages of the last proposals, `WINDOW` at most, are evidence of mistakes."""
    return bool(advantages) and sum(advantages) >= _ENOUGH * len(advantages)
