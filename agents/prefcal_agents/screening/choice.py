"""Which simulated θ is worth showing, and whether any still is."""

import numpy as np
from jaxtyping import Bool, Float

_CLEAR = (0.1, 0.25)
"""Smallest difference that is clear: a share of the larger value, and one of the middle half of
all good simulations."""
_NEAR = 0.2
"""Distance in the cube, over the square root of the number of knobs, up to which θ are near."""
_ALIKE = 3.0
"""Ranks below this are worth about the same: the very first ones are a matter of chance."""


def worth(costs: Float[np.ndarray, "s m"]) -> Float[np.ndarray, "s m"]:
    """Return the negative logarithm of the rank of each θ in each draw, plus 3, shape (s, m).

    Halving the number of better θ is worth the same everywhere, from a poor θ to the very best.
    """
    order = np.argsort(costs, axis=1, kind="stable")
    ranks = np.empty(costs.shape)
    np.put_along_axis(ranks, order, np.arange(1.0, costs.shape[1] + 1.0)[None], axis=1)
    return np.asarray(-np.log(ranks + _ALIKE))


def expected_best(costs: Float[np.ndarray, "s m"], best: int | None) -> Float[np.ndarray, " m"]:
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


def clearly_apart(
    kpis: Float[np.ndarray, "m k"], good: Bool[np.ndarray, " m"], row: int
) -> Bool[np.ndarray, " m"]:
    """Return which experiments differ clearly from one of them in some KPI, shape (m,).

    Args:
        kpis: KPIs as people read them, shape (m, k).
        good: Experiments that tell which differences are usual, shape (m,).
        row: Row of the experiment.
    """
    apart = np.zeros(len(kpis), dtype=np.bool_)
    for values in kpis.T:
        known = values[good & np.isfinite(values)]
        if not len(known) or not np.isfinite(values[row]):
            continue
        larger = np.maximum(np.abs(values), abs(values[row]))
        with np.errstate(invalid="ignore", over="ignore"):  # infinite, or nearly so
            usual = float(np.subtract(*np.percentile(known, [75, 25])))
            least = np.maximum(_CLEAR[0] * larger, _CLEAR[1] * usual)
            apart |= (usual > 0) & (np.abs(values - values[row]) >= least)
    return apart


def trend(
    z: Float[np.ndarray, "m n"], costs: Float[np.ndarray, "s m"], row: int
) -> Float[np.ndarray, " n"]:
    """Return how the expected worth grows along each knob near one θ, shape (n,).

    It is the slope of a plane through the θ of the bank, of which those near count more.

    Args:
        z: Points of the cube, shape (m, n).
        costs: Their costs in each draw, shape (s, m).
        row: Row of the θ.
    """
    steps = z - z[row]
    near = np.exp(-0.5 * np.sum(steps**2, axis=1) / (_NEAR**2 * z.shape[1]))
    plane = np.column_stack([np.ones(len(z)), steps])
    weighted = plane.T * near
    square = weighted @ plane + 1e-6 * np.eye(plane.shape[1])
    return np.asarray(np.linalg.solve(square, weighted @ worth(costs).mean(axis=0))[1:])
