"""A menu of three: the result, and two candidates that people like this one might prefer to it."""

import numpy as np
from jaxtyping import Bool, Float

_OTHERS = 2
_PERHAPS = 0.25
"""Probability of not being noticeably worse than the result that a candidate must have."""
_ENOUGH = 0.8
"""Share of the largest gain that a candidate must have; the one that differs most is taken."""


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
