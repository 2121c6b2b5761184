"""Choosing ε by K-fold cross-validation on the preferences themselves.

Source: end of the section "Training a surrogate function from preferences" of the paper.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from prefcal_env.qp import Backend

from .ledger import Preferences
from .rbf import squared_distances
from .surrogate import Hyper, basis, fit


def choose_epsilon(
    preferences: Preferences,
    candidates: Sequence[float],
    hyper: Hyper,
    backend: Backend,
    *,
    folds: int,
    rng: np.random.Generator,
) -> float:
    """The ε whose surrogates reproduce most of the preferences that were left out.

    Every comparison is left out once, in one of `folds` slices; all samples stay centres. Among
    equally good candidates (a few dozen answers leave many) the middle one is taken.

    Args:
        preferences: M comparisons, at least as many as `folds`.
        candidates: Values of ε to try, in increasing order.
        hyper: φ, σ and λ.
        backend: QP solver.
        folds: K.
        rng: Deals the comparisons out to the slices.
    """
    d = squared_distances(preferences.samples, preferences.samples)
    slices = np.array_split(rng.permutation(len(preferences)), folds)
    scores = [
        _reproduced(preferences, basis(d, epsilon, hyper.rbf), slices, hyper, backend)
        for epsilon in candidates
    ]
    winners = [e for e, s in zip(candidates, scores, strict=True) if s == max(scores)]
    return winners[len(winners) // 2]


def _reproduced(
    preferences: Preferences,
    phi: Float[np.ndarray, "N N"],
    slices: Sequence[np.ndarray],
    hyper: Hyper,
    backend: Backend,
) -> int:
    """How many left-out preferences surrogates on basis `phi` get right (eq. RBF-pref)."""
    right = 0
    everything = np.arange(len(preferences))
    for left_out in slices:
        kept = preferences.subset(np.setdiff1d(everything, left_out))
        values = phi @ fit(kept, phi, hyper, backend)
        test = preferences.subset(left_out)
        gap = values[test.first] - values[test.second]
        as_good = np.abs(gap) <= hyper.sigma
        right += int(np.sum(np.where(test.b == 0, as_good, test.b * gap > 0)))
    return right
