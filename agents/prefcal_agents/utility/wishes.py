"""What a person wanted from the KPIs, as statements with their certainty.

Statements are about verdicts, not about the form of a draw, so that orders and trade-offs agree or
not: what would be noticed as worse than the result, and which KPI decides more pairs.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_env.preferences.history import History

from .pool import Pool
from .utilities import Utilities

_POWER = 0.5
"""Power of the answers' likelihood, by which the certainties hold for people unlike the draws."""
_DRAWS = 1024
_MARKS = np.linspace(0.0, 0.95, 20)
"""Shares of the worse values of a KPI among which its bound is sought."""
_LIKELY = 0.8
"""Certainty that a bound must have."""
_SAID = 0.5
"""Certainty below which nothing is said of a KPI."""
_MOST = 3
_PAIRS = 200
_NOTICED = 0.25
"""Share of those who object that must notice what a candidate gains in their KPI alone."""


@dataclass(frozen=True, slots=True)
class Wished:
    """One KPI that the person wanted low.

    Args:
        name: Name of the KPI.
        bound: Value from which on the result would be noticeably worse, all other KPIs the same,
            lower is better; None if no value is that sure, and lower is all that is known.
        certainty: Probability of that; without a bound, that a poor value would be noticed.
        first: Probability that no KPI that is named after it decides more pairs; 1 for the last one.
    """

    name: str
    bound: float | None
    certainty: float
    first: float


def wishes(pool: Pool, history: History, spread: Int[np.ndarray, " r"], result: int) -> tuple[Wished, ...]:
    """Return what the person wanted, what decides most first; empty if nothing is likely.

    Args:
        pool: Draws of the study.
        history: Samples and answers.
        spread: Rows of the bank that fill the space, shape (r,).
        result: Row of the result.
    """
    usable = spread[~pool.bank.hopeless[spread]]
    if len(usable) < 2 or not pool.scale.names or not history.lessons():
        return ()
    draws = cautious(pool, history)
    share = deciding(draws, pool.logs, usable)
    bounds = [_bound(pool, draws, usable, result, kpi) for kpi in range(share.shape[1])]
    said = [kpi for kpi, (_, certainty) in enumerate(bounds) if certainty >= _SAID]
    order: list[int] = []
    while said and len(order) < _MOST:
        leads = np.bincount(np.argmax(share[:, said], axis=1), minlength=len(said))
        order.append(said.pop(int(np.argmax(leads))))
    return tuple(
        Wished(pool.scale.names[kpi], *bounds[kpi], _leads(share, kpi, order[place + 1 :]))
        for place, kpi in enumerate(order)
    )


def cautious(pool: Pool, history: History) -> Utilities:
    """Return draws whose certainties hold for people unlike the draws, too."""
    return pool.drawn(history, _DRAWS, _POWER)


def deciding(
    draws: Utilities, logs: Float[np.ndarray, "m k"], rows: Int[np.ndarray, " r"]
) -> Float[np.ndarray, "s k"]:
    """Return the share of pairs that each KPI decides in each draw, shape (s, k).

    It decides a pair if the verdict is another one once both are the same in it.

    Args:
        draws: Draws of what the person wants.
        logs: Log distances of the KPIs, shape (m, k).
        rows: Rows from which pairs are made, shape (r,).
    """
    first, second = pairs(rows)
    shown, place = np.unique([first, second], return_inverse=True)
    one, other = place.reshape(2, -1)
    parts = draws.gains(draws.levels(logs[shown]), one, other)
    own = parts[: logs.shape[1]] + parts[logs.shape[1] :]  # a KPI and its stated limit
    total = own.sum(axis=0)
    return np.array([(_verdict(total - each) != _verdict(total)).mean(axis=1) for each in own]).T


def objections(
    pool: Pool, history: History, spread: Int[np.ndarray, " r"], result: int, first: str
) -> dict[str, int]:
    """Return the row to compare with the result if a KPI matters more than was said, by its name.

    Of the drawn people to whom the KPI decides more pairs than `first` does, the most prefer this row,
    and some notice what it gains in that KPI alone. A KPI in which nothing new does so has none.

    Args:
        pool: Draws of the study.
        history: Samples and answers.
        spread: Rows of the bank that fill the space, shape (r,).
        result: Row of the result.
        first: Name of the KPI that was said to come first.
    """
    draws, logs, found = cautious(pool, history), pool.logs, dict[str, int]()
    share = deciding(draws, logs, spread[~pool.bank.hopeless[spread]])
    prefer = _prefer(draws, logs, result)
    free = ~pool.bank.hopeless & ~np.isin(np.arange(len(logs)), pool.shown)
    for kpi, name in enumerate(pool.scale.names):
        objectors = np.flatnonzero(share[:, kpi] > share[:, pool.scale.names.index(first)])
        alone = np.repeat(logs[[result]], len(logs), axis=0)
        alone[:, kpi] = logs[:, kpi]
        if len(objectors):
            gains = free & (_prefer(draws.take(objectors), alone, result).mean(axis=0) >= _NOTICED)
            liked = np.where(gains, prefer[objectors].mean(axis=0), 0.0)
            if liked.any():
                found[name] = int(np.argmax(liked))
    return found


def _prefer(draws: Utilities, logs: Float[np.ndarray, "m k"], result: int) -> Bool[np.ndarray, "s m"]:
    """Return whether each draw finds each row noticeably better than the result, shape (s, m)."""
    costs = draws.costs(logs)
    return np.asarray(costs < costs[:, [result]] - 1.0)


def _leads(share: Float[np.ndarray, "s k"], kpi: int, later: list[int]) -> float:
    """Return how probably a KPI decides no fewer pairs than each of the `later` ones."""
    return float((share[:, [kpi]] >= share[:, later]).all(axis=1).mean())


def pairs(rows: Int[np.ndarray, " r"]) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Return some pairs of different `rows`, each of shape (p,), the same ones each time."""
    count = min(_PAIRS, len(rows) * (len(rows) - 1) // 2)
    first, second = np.triu_indices(len(rows), 1)
    some = np.linspace(0, len(first) - 1, count).astype(np.int64)
    return rows[first[some]], rows[second[some]]


def _verdict(gain: Float[np.ndarray, "s p"]) -> Int[np.ndarray, "s p"]:
    return (gain > 1.0).astype(np.int64) - (gain < -1.0)


def _bound(
    pool: Pool, draws: Utilities, rows: Int[np.ndarray, " r"], result: int, kpi: int
) -> tuple[float | None, float]:
    """Return the bound of a KPI and its certainty; none is certain beyond all values that were shown."""
    values = marks(pool, rows, result, kpi)
    if not len(values):
        return None, 0.0
    logs = np.repeat(pool.logs[[result]], len(values) + 1, axis=0)
    logs[1:, kpi] = np.log(np.maximum(values - pool.scale.good[kpi], pool.scale.floor[kpi]))
    certain = noticed_worse(draws, logs)
    if certain.max() < _LIKELY:
        return None, float(certain[-1])
    place = int(np.argmax(certain >= _LIKELY))
    shown = pool.bank.kpis[pool.shown, pool.bank.names.index(pool.scale.names[kpi])]
    if not np.any(np.isfinite(shown) & (shown >= values[place])):
        return None, 0.0
    return float(values[place]), float(certain[place])


def noticed_worse(draws: Utilities, logs: Float[np.ndarray, "m k"]) -> Float[np.ndarray, " q"]:
    """Return the share of draws to which each row but the first is noticeably worse than it, shape (q,).

    Args:
        draws: Draws of what the person wants.
        logs: Log distances of the KPIs, shape (m, k), with m = q + 1.
    """
    others = np.arange(1, len(logs))
    gains = draws.gains(draws.levels(logs), np.zeros_like(others), others).sum(axis=0)
    return np.asarray((gains > 1.0).mean(axis=0))


def marks(pool: Pool, rows: Int[np.ndarray, " r"], result: int, kpi: int) -> Float[np.ndarray, " q"]:
    """Return values of a KPI that are worse than that of the result, rising, shape (q,)."""
    column = pool.bank.kpis[:, pool.bank.names.index(pool.scale.names[kpi])]
    here, usual = column[result], column[rows]
    worse = np.unique(usual[np.isfinite(usual) & (usual > here)])
    return np.unique(np.quantile(worse, _MARKS)) if len(worse) > 1 and np.isfinite(here) else worse[:0]
