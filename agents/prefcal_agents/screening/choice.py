"""Which simulated θ is worth showing, and whether any still is."""

import numpy as np
from jaxtyping import Float


def worth(costs: Float[np.ndarray, "s m"]) -> Float[np.ndarray, "s m"]:
    """Return the negative logarithm of the rank of each θ in each draw, shape (s, m).

    Halving the number of better θ is worth the same everywhere, from a poor θ to the very best.
    """
    order = np.argsort(costs, axis=1, kind="stable")
    ranks = np.empty(costs.shape)
    np.put_along_axis(ranks, order, np.arange(1.0, costs.shape[1] + 1.0)[None], axis=1)
    return np.asarray(-np.log(ranks))


def expected_best(
    costs: Float[np.ndarray, "s m"], best: int | None
) -> Float[np.ndarray, " m"]:
    """Return the expected worth of the better one of each θ and the best so far, shape (m,).

    The answer decides which of both is kept, so the θ with the largest value is the one to show.

    Source: Z. J. Lin et al., "Preference exploration for efficient Bayesian optimization with
    multiple outcomes" (2022): the expected utility of the best option.
    Deviation: the utility is the logarithm of the rank, since a draw of the cost has no unit.

    Args:
        costs: Cost of each θ in each draw, shape (s, m).
        best: Row of the best one so far; None if nothing was shown.
    """
    found = worth(costs)
    if best is not None:
        found = np.maximum(found, found[:, best, None])
    return np.asarray(found.mean(axis=0))
