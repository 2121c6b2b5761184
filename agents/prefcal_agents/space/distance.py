"""Distances between points."""

import numpy as np
from jaxtyping import Float


def squared_distances(
    a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]
) -> Float[np.ndarray, "m N"]:
    """Return d of eq. distance between all rows of `a` and all of `b`, shape (m, N).

    Differences are taken before squaring: near the optimum samples lie within 1e-6 of each
    other, where |a|² + |b|² - 2ab has no correct digit.
    """
    d = np.zeros((len(a), len(b)))
    for k in range(a.shape[1]):
        difference = a[:, k, None] - b[:, k]
        d += difference * difference
    return d
