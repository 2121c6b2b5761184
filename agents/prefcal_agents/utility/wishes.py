"""Which KPIs a person wanted better, with how sure that is.

It is a statement about verdicts, not about the form of a draw, so that orders and trade-offs agree or
not: whether a worse value would be noticed.
"""

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.preferences.history import History

from .pool import Pool
from .utilities import Utilities

_POWER = 0.5
"""Power of the answers' likelihood, by which the certainties hold for people unlike the draws."""
_DRAWS = 1024
_MARKS = np.linspace(0.0, 0.95, 20)
"""Shares of the worse values of a KPI that are tried, the best of them first."""
_SURE = 0.8
"""Certainty from which on a wish is named. 11 of 12 such wishes were the person's own, but only 6 of 15
less sure ones, and none of the 11 limits that were named with them (docs/research/archive.md)."""


def wishes(pool: Pool, history: History, spread: Int[np.ndarray, " r"], result: int) -> dict[str, float]:
    """Return how surely the person wanted each KPI better; only those that are sure enough are named.

    Args:
        pool: Draws of the study.
        history: Samples and answers.
        spread: Rows of the bank that fill the space, shape (r,).
        result: Row of the result.
    """
    usable = spread[~pool.bank.hopeless[spread]]
    if len(usable) < 2 or not history.lessons():
        return {}
    draws = cautious(pool, history)
    found = {name: _certainty(pool, draws, usable, result, k) for k, name in enumerate(pool.scale.names)}
    return {name: certainty for name, certainty in found.items() if certainty >= _SURE}


def cautious(pool: Pool, history: History) -> Utilities:
    """Return draws whose certainties hold for people unlike the draws, too."""
    return pool.drawn(history, _DRAWS, _POWER)


def _certainty(pool: Pool, draws: Utilities, rows: Int[np.ndarray, " r"], result: int, kpi: int) -> float:
    """Return how surely a worse value would be noticed, all other KPIs the same.

    The value is the first that is sure enough; 0 if there is none, or if no shown run has it or a worse
    one: the person has never judged such a value.
    """
    column = pool.bank.kpis[:, pool.bank.names.index(pool.scale.names[kpi])]
    usual = column[rows]
    worse = np.unique(usual[np.isfinite(usual) & (usual > column[result])])
    if len(worse) < 2 or not np.isfinite(column[result]):
        return 0.0
    values = np.unique(np.quantile(worse, _MARKS))
    logs = np.repeat(pool.logs[[result]], len(values) + 1, axis=0)
    logs[1:, kpi] = np.log(np.maximum(values - pool.scale.good[kpi], pool.scale.floor[kpi]))
    certain = noticed_worse(draws, logs)
    place, shown = int(np.argmax(certain >= _SURE)), column[pool.shown]
    seen = np.any(np.isfinite(shown) & (shown >= values[place]))
    return float(certain[place]) if seen else 0.0


def noticed_worse(draws: Utilities, logs: Float[np.ndarray, "m k"]) -> Float[np.ndarray, " q"]:
    """Return the share of draws to which each row but the first is noticeably worse than it, shape (q,).

    Args:
        draws: Draws of what the person wants.
        logs: Log distances of the KPIs, shape (m, k), with m = q + 1.
    """
    others = np.arange(1, len(logs))
    gains = draws.gains(draws.levels(logs), np.zeros_like(others), others).sum(axis=0)
    return np.asarray((gains > 1.0).mean(axis=0))
