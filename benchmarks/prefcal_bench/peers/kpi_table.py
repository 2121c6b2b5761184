"""Collect the KPIs of all experiments in one table for Gaussian processes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.history.lessons import kpis_of
from prefcal_agents.models.interpolant import normalized
from prefcal_agents.models.kpi_model import CEILING
from prefcal_env.preferences.history import History

_NEVER = 1.1
"""Share of an infinite value: a bit worse than the worst finite one."""
_FEWEST = 3  # minimum number of experiments with KPIs


@dataclass(frozen=True, slots=True)
class KPITable:
    """The p KPIs of the K experiments that have some.

    Args:
        rows: Indices of the samples, increasing, shape (K,).
        shares: KPIs, lower is better: 0 for the best value and 1 for the worst, which is capped as
            `normalized` says; 1.1 for an infinite one, shape (K, p).
    """

    rows: Int[np.ndarray, " K"]
    shares: Float[np.ndarray, "K p"]

    @classmethod
    def of(cls, history: History) -> "KPITable | None":
        """Return the KPIs that came with the answers; None if there are too few to learn from.

        A missing value counts as the mean of the others. A KPI that never differs is left out.
        """
        known, cut = kpis_of(history), history.cut_short()  # KPIs of the latter are bounds
        rows = [index for index, outcome in enumerate(known) if outcome and index not in cut]
        if len(rows) < _FEWEST:
            return None
        names = sorted({name for index in rows for name in known[index]})
        columns = [_shares([known[index] for index in rows], name) for name in names]
        columns = [column for column in columns if np.ptp(column) > 0]
        if not columns:
            return None
        return cls(np.array(rows, dtype=np.int64), np.stack(columns, axis=1))

    def pairs(self, pairs: Int[np.ndarray, "M 2"]) -> Int[np.ndarray, "L 2"]:
        """Return the pairs of samples of which both are in the table, as pairs of its rows."""
        both = np.isin(pairs, self.rows).all(axis=1)
        return np.searchsorted(self.rows, pairs[both])


def _shares(known: Sequence[Mapping[str, float]], name: str) -> Float[np.ndarray, " K"]:
    values = np.array([outcome.get(name, np.nan) for outcome in known], dtype=float)
    finite = np.isfinite(values)
    shares = np.where(values > 0, _NEVER, 0.0)
    if finite.any():
        shares[finite] = normalized(values[finite], CEILING)
    missing = np.isnan(values)
    shares[missing] = shares[~missing].mean() if not missing.all() else 0.0
    return shares
