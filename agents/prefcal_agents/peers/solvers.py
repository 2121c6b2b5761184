"""Set up a solver of the package `glis` on the unit cube."""

from typing import Any

import numpy as np
from jaxtyping import Float


def design(solver: Any, n: int, count: int) -> Float[np.ndarray, "count n"]:
    """Return the first `count` samples of the class `solver`, from numpy's global generator."""
    fresh = solver(bounds=(np.zeros(n), np.ones(n)), n_initial_random=count, display=0)
    fresh.initialize_()
    return np.array(fresh.X)


def cube_solver(solver: Any, z: Float[np.ndarray, "N n"], **options: Any) -> Any:
    """Return an instance of the class `solver` whose initial samples are `z`, shape (N, n).

    The package treats all samples alike once they ran, so all of them can be initial samples:
    after the answer about the last one, it proposes the next.
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
