"""Statistics of gaps: quartiles, and paired differences with their uncertainty."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError

FLOOR = 1e-9
"""Value that replaces smaller gaps, about the accuracy of the test functions' optima."""
CONFIDENCE = 0.95
_RESAMPLES = 9999

Average = Literal["median", "mean"]


@dataclass(frozen=True, slots=True)
class Quartiles:
    """Quartiles of some values, in their unit."""

    low: float
    median: float
    high: float


@dataclass(frozen=True, slots=True)
class Difference:
    """Comparison of an agent with a baseline on one problem, paired by seed.

    Args:
        pairs: Number of seeds that both have.
        log10_ratio: Average of log10(gap / baseline's gap); negative if the agent is better.
        low: Lower end of its 95 % bootstrap interval; None with fewer than two pairs.
        high: Upper end of that interval.
        wins: Number of seeds in which the agent's gap is smaller.
        ties: Number of seeds in which both are equal.
        losses: Number of seeds in which the baseline's is smaller.
        p: p value of the two-sided Wilcoxon signed-rank test; 1 if all are ties.
    """

    pairs: int
    log10_ratio: float
    low: float | None
    high: float | None
    wins: int
    ties: int
    losses: int
    p: float


def quartiles(values: Sequence[float] | Float[np.ndarray, " N"]) -> Quartiles:
    """Return the linearly interpolated quartiles of one value or more."""
    low, median, high = np.quantile(np.asarray(values, dtype=float), [0.25, 0.5, 0.75])
    return Quartiles(float(low), float(median), float(high))


def logarithm(gaps: Float[np.ndarray, "..."], floor: float = FLOOR) -> Float[np.ndarray, "..."]:
    """Return log10 of gaps, each raised to at least `floor`."""
    return np.asarray(np.log10(np.maximum(gaps, floor)))


def difference(
    gaps: Float[np.ndarray, " S"],
    baseline: Float[np.ndarray, " S"],
    *,
    rng: np.random.Generator,
    floor: float = FLOOR,
    average: Average = "median",
) -> Difference:
    """Compare two agents' final gaps, paired by seed.

    Args:
        gaps: Gaps of the agent, shape (S,), one or more.
        baseline: Gaps of the other agent for the same seeds, shape (S,).
        rng: Generator of the bootstrap's resamples (percentile method).
        floor: Value that replaces smaller gaps.
        average: Average of the logarithms of the ratios.

    Raises:
        SettingsError: If there are no gaps, or the numbers of gaps differ.
    """
    from scipy.stats import wilcoxon

    if len(gaps) != len(baseline) or not len(gaps):
        raise SettingsError(
            f"gaps must come in pairs, one or more, got {len(gaps)} and {len(baseline)}"
        )
    d = logarithm(gaps, floor) - logarithm(baseline, floor)
    middle = np.median if average == "median" else np.mean
    low, high = _interval(d, middle, rng)
    return Difference(
        pairs=len(d),
        log10_ratio=float(middle(d)),
        low=low,
        high=high,
        wins=int((d < 0).sum()),
        ties=int((d == 0).sum()),
        losses=int((d > 0).sum()),
        p=float(wilcoxon(d).pvalue) if d.any() else 1.0,
    )


def _interval(
    d: Float[np.ndarray, " S"], middle: Callable[..., Any], rng: np.random.Generator
) -> tuple[float, float] | tuple[None, None]:
    """Return the bootstrap interval of the average of `d`; None for a single value."""
    from scipy.stats import bootstrap

    if len(d) < 2:
        return None, None
    interval = bootstrap(
        (d,), middle, n_resamples=_RESAMPLES, confidence_level=CONFIDENCE, method="percentile",
        rng=rng,
    ).confidence_interval  # fmt: skip
    return float(interval.low), float(interval.high)


def holm(p: Sequence[float]) -> list[float]:
    """Return p values corrected for multiple tests.

    Source: Holm (1979), the step-down method, as adjusted p values.
    """
    values = np.asarray(p, dtype=float)
    order = np.argsort(values, kind="stable")
    factors = np.arange(len(values), 0, -1)
    adjusted = np.empty(len(values))
    adjusted[order] = np.minimum(np.maximum.accumulate(values[order] * factors), 1.0)
    return [float(v) for v in adjusted]
