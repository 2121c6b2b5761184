"""Which simulated θ is worth showing, and whether any still is."""

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.preferences.history import History

_CLEAR = (0.1, 0.25)
"""Smallest difference that is clear: a share of the larger value, and one of the middle half of
all good simulations."""
_NEAR = 0.2
"""Distance in the cube, over the square root of the number of knobs, up to which θ are near."""
LOOK = 60
"""Number of θ for which two answers are looked ahead."""
_TIE, _LESS = 0.4, 0.2
"""A question with a larger probability of a tie waits, if another one gains this share of what it
does."""
_ALIKE = 3.0
"""Ranks below this are worth about the same: the very first ones are a matter of chance."""

_DOUBT = 0.75
"""Probability of being noticeably better than the best by the answers above which an experiment
takes its place."""


def worth(costs: Float[np.ndarray, "s m"]) -> Float[np.ndarray, "s m"]:
    """Return the negative logarithm of the number of θ noticeably better than each, plus 4, (s, m).

    Halving the number of better θ is worth the same everywhere, from a poor θ to the very best.
    """
    better = [np.searchsorted(np.sort(row), row - 1.0) for row in costs]
    return np.asarray(-np.log(np.array(better).reshape(costs.shape) + _ALIKE + 1.0))


def expected_best(costs: Float[np.ndarray, "s m"], best: int | None) -> Float[np.ndarray, " m"]:
    """Return the expected worth of the better one of each θ and the best so far, shape (m,).

    The answer decides which of both is kept, so the θ with the largest value is the one to show.
    Where the person would not notice that it is better, it is kept by chance, and counts nothing.

    Source: Z. J. Lin et al., "Preference exploration for efficient Bayesian optimization with
    multiple outcomes" (2022): the expected utility of the best option.
    Deviation: the utility is the logarithm of the rank, since a draw of the cost has no unit.

    Args:
        costs: Cost of each θ in each draw, shape (s, m).
        best: Row of the best one so far; None if nothing was shown.
    """
    found = worth(costs)
    return np.asarray((found if best is None else _kept(costs, found, best)).mean(axis=0))


def now_and_next(
    costs: Float[np.ndarray, "s m"], best: int, allowed: Bool[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Return the mean of what is expected after this answer and after the next one, shape (m,).

    What is expected is the worth of the best one; the next question is the best one for each of the
    three answers. Without the first half, a question that leads nowhere could come before a good
    one. Only the θ that promise most by one answer are looked at; others are worth -inf.

    Source: J. González, M. Osborne, N. Lawrence, "GLASSES: relieving the myopia of Bayesian
    optimisation" (2016).
    Deviation: two answers ahead, not all; and the mean, since a person may stop after each.

    Args:
        costs: Cost of each θ in each draw, shape (s, m).
        best: Row of the best one so far.
        allowed: θ that may be shown, shape (m,).
    """
    found = worth(costs)
    kept = _kept(costs, found, best)
    now = np.where(_telling(costs, kept, best, allowed), kept.mean(axis=0), -np.inf)
    value = np.full(len(now), -np.inf)
    for row in np.argsort(-now, kind="stable")[: min(LOOK, np.count_nonzero(np.isfinite(now)))]:
        won, lost = (sign * (costs[:, best] - costs[:, row]) > 1.0 for sign in (1, -1))
        after = [_kept(costs[won], found[won], row), kept[lost], kept[~won & ~lost]]
        then = sum(each[:, allowed].sum(axis=0).max() for each in after) / len(costs)
        value[row] = (now[row] + then) / 2
    return value


def _telling(
    costs: Float[np.ndarray, "s m"],
    kept: Float[np.ndarray, "s m"],
    best: int,
    allowed: Bool[np.ndarray, " m"],
) -> Bool[np.ndarray, " m"]:
    """Return `allowed` without likely ties, if what is left promises enough, shape (m,)."""
    gain = kept.mean(axis=0) - kept[:, best].mean()
    clear = allowed & (np.mean(np.abs(costs - costs[:, [best]]) <= 1.0, axis=0) <= _TIE)
    enough = gain[clear].max(initial=0.0) > _LESS * gain[allowed].max(initial=0.0)
    return clear if enough else allowed


def _kept(
    costs: Float[np.ndarray, "s m"], found: Float[np.ndarray, "s m"], best: int
) -> Float[np.ndarray, "s m"]:
    """Return the worth of the one that is kept if each θ is compared with the best, (s, m)."""
    noticed = costs < costs[:, [best]] - 1.0
    return np.asarray(np.where(noticed, found, found[:, [best]]))


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


def trend(z: Float[np.ndarray, "m n"], costs: Float[np.ndarray, "s m"], row: int) -> Float[np.ndarray, " n"]:
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


def overtaking(better: Float[np.ndarray, " n"], history: History) -> Float[np.ndarray, " n"]:
    """Return how probably each sample is noticeably better than the best by the answers, (n,).

    It is 0 unless the probability is above 0.75, and for those that were unsafe or cut short.
    """
    found = np.where(better > _DOUBT, better, 0.0)
    found[[*history.unsafe(), *history.cut_short()]] = 0.0
    return found
