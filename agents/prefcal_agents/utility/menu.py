"""A menu of three: the result, and two candidates that people like this one might prefer to it."""

import numpy as np
from jaxtyping import Bool, Float

_OTHERS = 2
_PERHAPS = 0.25
"""Probability of not being noticeably worse than the result that a candidate must have."""
_ENOUGH = 0.8
"""Share of the largest gain that a candidate must have; the one that differs most is taken."""
_STOPS = 9
"""Number of places between two candidates at which a third one is sought."""


def others(
    costs: Float[np.ndarray, "s m"],
    logs: Float[np.ndarray, "m k"],
    usable: Bool[np.ndarray, " m"],
    result: int,
) -> tuple[int, ...]:
    """Return up to two rows that, beside the result, satisfy most of the drawn people.

    A person is satisfied by what is not noticeably worse than the best of all candidates. The next
    row satisfies most of those who are not yet, or nearly so, and of such rows it is the one whose
    KPIs differ most from what is on the menu, in ranks.

    Source: G. L. Nemhauser, L. A. Wolsey, M. L. Fisher, "An analysis of approximations for
    maximizing submodular set functions" (1978): the greedy choice satisfies at least 63 % of those
    whom the best choice would.

    Args:
        costs: Cost of each candidate in each draw, shape (s, m).
        logs: Log distances of their KPIs, shape (m, k).
        usable: Candidates that may be on the menu, shape (m,).
        result: Row of the result.
    """
    best = np.where(usable, costs, np.inf).min(axis=1, keepdims=True)
    perhaps = (costs <= costs[:, [result]] + 1.0).mean(axis=0) >= _PERHAPS
    satisfied = (costs <= best + 1.0) & usable
    ranks = np.argsort(np.argsort(logs, axis=0, kind="stable"), axis=0) / len(logs)
    menu = [result]
    for _ in range(_OTHERS):
        gain = perhaps * (satisfied & ~satisfied[:, menu].any(axis=1)[:, None]).mean(axis=0)
        if not gain.any():
            break
        apart = np.abs(ranks[:, None] - ranks[menu]).max(axis=2, initial=0.0).min(axis=1)
        menu.append(int(np.argmax(np.where(gain >= _ENOUGH * gain.max(), apart, -1.0))))
    return tuple(menu[1:])


def unbeaten(kpis: Float[np.ndarray, "m k"], usable: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Return which usable rows have no other one that is better in a KPI and in none worse, shape (m,).

    Args:
        kpis: KPIs, lower is better, shape (m, k).
        usable: Candidates that may be shown, shape (m,).
    """
    found = usable.copy()
    for row in np.flatnonzero(usable):
        rivals, own = kpis[found], kpis[row]
        found[row] = not np.any((rivals <= own).all(axis=1) & (rivals < own).any(axis=1))
    return found


def between(
    kpis: Float[np.ndarray, "m k"], stops: Bool[np.ndarray, " m"], one: int, other: int
) -> tuple[int, ...]:
    """Return rows on the way from row `one` to row `other`, both included, in this order.

    Those between are nearest to places on the straight line of KPIs in ranks, where equal values have
    the same rank.

    Args:
        kpis: KPIs, lower is better, shape (m, k).
        stops: Candidates that may lie between, such as those that are `unbeaten`, shape (m,).
        one: Row where it begins.
        other: Row where it ends.
    """
    ranks = np.zeros(kpis.shape)
    for place, column in enumerate(kpis.T):
        ranks[:, place] = np.unique(column, return_inverse=True)[1]
    from_one = (ranks - ranks[one]) / np.maximum(ranks.max(axis=0), 1.0)
    way = from_one[other]
    along = from_one @ way / (way @ way or 1.0)
    rows = np.flatnonzero(stops & (along > 0.0) & (along < 1.0))
    parts = np.linspace(0.0, 1.0, _STOPS + 2)[1:-1, None, None]
    apart = ((from_one[rows] - parts * way) ** 2).sum(axis=2)
    middle = rows[np.argmin(apart, axis=1)].tolist() if len(rows) else []
    return (one, *dict.fromkeys(middle), other)
