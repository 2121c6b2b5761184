"""What usual runs say about a KPI, for drawing tastes."""

import numpy as np
from jaxtyping import Float

from .runs import Runs


def some(runs: Runs, rng: np.random.Generator, low: int, high: int) -> tuple[str, ...]:
    """Return between `low` and `high` names of KPIs in random order, as far as there are any."""
    high = min(high, len(runs.names))
    count = int(rng.integers(min(low, high), high + 1))
    return tuple(runs.names[i] for i in rng.permutation(len(runs.names))[:count])


def finished(runs: Runs, name: str) -> Float[np.ndarray, " k"]:
    """Return the finite values of runs that were not interrupted; a single 0 if there are none."""
    values = runs.column(name)[np.isinf(runs.survived)]
    finite = values[np.isfinite(values)]
    return finite if len(finite) else np.zeros(1)


def good(runs: Runs, name: str) -> float:
    """Return 0, or the lowest value if the KPI can be negative."""
    return min(float(finished(runs, name).min()), 0.0)


def distance(runs: Runs, name: str, share: float) -> float:
    """Return the quantile of the distance to the good value, above 0."""
    distances = finished(runs, name) - good(runs, name)
    positive = distances[distances > 0]
    if not len(positive):
        return 1.0
    return float(max(np.quantile(distances, share), positive.min()))


def spread(runs: Runs, name: str) -> float:
    """Return how far good runs and poor ones are apart: the 5 to the 80 % quantile, above 0."""
    values = finished(runs, name)
    low, high = np.quantile(values, (0.05, 0.8))
    return float(high - low) or float(np.ptp(values)) or 1.0
