"""The KPIs of all samples, each from 0 for the best to 1 for the worst."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.history.lessons import cube_of, kpis_of
from prefcal_env.preferences.history import History

from .interpolant import best_interpolants, normalized

CEILING = 2.0  # see `normalized`: an interrupted run must not flatten the other differences
_EPSILONS = (0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2)
_RBF = "inverse_quadratic"
_FEWEST = 3  # minimum number of values of a KPI to predict it


@dataclass(frozen=True, slots=True)
class Outcomes:
    """The p KPIs of N samples.

    Args:
        columns: KPIs, lower is better: 0 for the best sample and 1 for the worst, shape (N, p).
        names: Names of the p KPIs.
        ranges: Values of each KPI that count as 0 and as 1, in its unit.
    """

    columns: Float[np.ndarray, "N p"]
    names: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, history: History) -> "Outcomes":
        """Return the KPIs that came with the answers in `history`.

        A missing value or NaN is filled in by the KPI's interpolant; an infinite value counts as
        the worst. A KPI with fewer than three values, or with one value only, is left out because
        nothing can be learned from it.
        """
        known = kpis_of(history)
        x = 2 * cube_of(history) - 1
        # KPIs that are known for the same samples share the expensive part.
        alike: dict[tuple[int, ...], list[_KPI]] = {}
        for name in sorted({name for outcome in known for name in outcome}):
            kpi = _KPI.of(known, name)
            if len(kpi.there) >= _FEWEST and np.ptp(kpi.shares) > 0:
                alike.setdefault(tuple(kpi.there), []).append(kpi)
        columns: list[Float[np.ndarray, " N"]] = []
        kpis: list[_KPI] = []
        for group in alike.values():
            there, shares = group[0].there, np.array([kpi.shares for kpi in group]).T
            filled = np.zeros((len(x), len(group)))
            if len(there) < len(x):
                best = best_interpolants(x[there], shares, _EPSILONS, _RBF)
                filled = np.array([np.clip(model(x), 0.0, 1.0) for model, _ in best]).T
            filled[there] = shares
            columns.extend(filled.T)
            kpis.extend(group)
        return cls(
            columns=np.array(columns).reshape(len(columns), len(x)).T,
            names=tuple(kpi.name for kpi in kpis),
            ranges=tuple(kpi.range for kpi in kpis),
        )

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, slots=True)
class _KPI:
    """One KPI: the samples where it is known, its shares there, and the values for 0 and 1."""

    name: str
    there: Int[np.ndarray, " K"]
    shares: Float[np.ndarray, " K"]
    range: tuple[float, float]

    @classmethod
    def of(cls, known: Sequence[Mapping[str, float]], name: str) -> "_KPI":
        values = np.array([outcome.get(name, np.nan) for outcome in known], dtype=float)
        there = np.flatnonzero(~np.isnan(values))
        values = values[there]
        finite = np.isfinite(values)
        shares = np.where(values > 0, 1.0, 0.0)  # for infinite values
        if not finite.any():
            return cls(name, there, shares, (0.0, np.inf))
        shares[finite] = normalized(values[finite], CEILING)
        best = float(values[finite].min())
        if not shares[finite].any():
            return cls(name, there, shares, (best, np.inf))  # only infinite values are worse
        # Shares are linear in the values up to the cap, or up to the largest value.
        inner = int(np.argmax(np.where(shares[finite] < 1.0, shares[finite], 0.0)))
        share, value = float(shares[finite][inner]), float(values[finite][inner])
        worst = best + (value - best) / share if share > 0 else float(values[finite].max())
        return cls(name, there, shares, (best, worst))
