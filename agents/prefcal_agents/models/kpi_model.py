"""The KPIs of all samples, each from 0 for the best to 1 for the worst."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import filled_kpis
from prefcal_env.preferences.history import History

from .interpolant import normalized

CEILING = 2.0  # see `normalized`: an interrupted run must not flatten the other differences


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

        For missing values see `filled_kpis`; an infinite value counts as the worst. A KPI with one
        value only is left out because nothing can be learned from it.
        """
        columns: dict[str, Float[np.ndarray, " N"]] = {}
        ranges = []
        for name, values in filled_kpis(history).items():
            shares, span = _shares(values)
            if np.ptp(shares) > 0:
                columns[name] = shares
                ranges.append(span)
        table = np.array(list(columns.values())).reshape(len(columns), history.answered).T
        return cls(table, tuple(columns), tuple(ranges))

    def __len__(self) -> int:
        return len(self.names)


def _shares(values: Float[np.ndarray, " K"]) -> tuple[Float[np.ndarray, " K"], tuple[float, float]]:
    """Return one KPI from 0 to 1, and the values that count as 0 and as 1."""
    finite = np.isfinite(values)
    shares = np.where(values > 0, 1.0, 0.0)  # for infinite values
    if not finite.any():
        return shares, (0.0, np.inf)
    shares[finite] = normalized(values[finite], CEILING)
    best = float(values[finite].min())
    if not shares[finite].any():
        return shares, (best, np.inf)  # only infinite values are worse
    # Shares are linear in the values up to the cap, or up to the largest value.
    inner = int(np.argmax(np.where(shares[finite] < 1.0, shares[finite], 0.0)))
    share, value = float(shares[finite][inner]), float(values[finite][inner])
    worst = best + (value - best) / share if share > 0 else float(values[finite].max())
    return shares, (best, worst)
