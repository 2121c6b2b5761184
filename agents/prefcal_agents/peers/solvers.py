"""Setting up a solver of the package `glis` on the unit cube."""

from typing import Any

import numpy as np
from jaxtyping import Float


def design(solver: Any, n: int, count: int) -> Float[np.ndarray, "count n"]:
    """The `count` samples that the class `solver` starts with, from numpy's global generator."""
    fresh = solver(bounds=(np.zeros(n), np.ones(n)), n_initial_random=count, display=0)
    fresh.initialize_()
    return np.array(fresh.X)


def cube_solver(solver: Any, z: Float[np.ndarray, "N n"], **options: Any) -> Any:
    """An instance of the class `solver` whose initial samples are `z`, shape (N, n).

    To the package every sample counts alike once it has run, so all that ran are its initial
    ones: told about the last, it proposes the next.
    """
    count, n = z.shape
    fresh = solver(bounds=(np.zeros(n), np.ones(n)), n_initial_random=count, display=0, **options)

    def samples() -> Float[np.ndarray, "N n"]:
        fresh.X = list(z)
        fresh.KnownFeasible = [1.0] * count
        scaled: Float[np.ndarray, "N n"] = 2 * z - 1
        return scaled

    fresh.initialize_ = samples
    return fresh
