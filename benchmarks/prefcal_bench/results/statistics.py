"""Statistics of gaps and of worth over seeds, with their uncertainty."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import bootstrap, trim_mean, wilcoxon

from prefcal_env.errors import SettingsError

FLOOR = 1e-9  # value that replaces smaller gaps, about the accuracy of the test functions' optima
CONFIDENCE = 0.95
_PAIRED, _RESAMPLES = 9999, 2000
"""Number of bootstrap resamples of paired gaps, and of worth, whose interval then varies by 2 %."""
Loops = Sequence[Float[np.ndarray, " _"]]
"""Worth of the studies of an agent, with an array over the seeds for each loop."""
Pair = tuple[str, int]  # loop and seed, which studies of two agents share


@dataclass(frozen=True, slots=True)
class Difference:
    """Comparison of an agent with a baseline on one problem, paired by seed."""

    pairs: int  # number of seeds that both have
    log10_ratio: float  # median of log10(gap / baseline's gap); negative if the agent is better
    log10_ratio_low: float | None  # lower end of its 95 % bootstrap interval; None with fewer than two pairs
    log10_ratio_high: float | None  # upper end of that interval
    wins: int  # number of seeds in which the agent's gap is smaller
    ties: int  # number of seeds in which both are equal
    losses: int  # number of seeds in which the baseline's is smaller
    p: float  # p value of the two-sided Wilcoxon signed-rank test; 1 if all are ties


@dataclass(frozen=True, slots=True)
class MeanEstimate:
    """A number with its 95 % bootstrap interval, which is None if no loop has two seeds."""

    value: float
    low: float | None
    high: float | None


def difference(
    gaps: Float[np.ndarray, " S"], baseline: Float[np.ndarray, " S"], *, rng: np.random.Generator
) -> Difference:
    """Compare two agents' final gaps, paired by seed; smaller ones count as `FLOOR`.

    Args:
        gaps: Gaps of the agent, shape (S,), one or more.
        baseline: Gaps of the other agent for the same seeds, shape (S,).
        rng: Generator of the bootstrap's resamples (percentile method).

    Raises:
        SettingsError: If there are no gaps, or the numbers of gaps differ.
    """
    if len(gaps) != len(baseline) or not len(gaps):
        raise SettingsError(f"gaps must come in pairs, one or more, got {len(gaps)} and {len(baseline)}")
    d = np.log10(np.maximum(gaps, FLOOR)) - np.log10(np.maximum(baseline, FLOOR))
    low, high = _interval(d, rng)
    return Difference(
        pairs=len(d),
        log10_ratio=float(np.median(d)),
        log10_ratio_low=low,
        log10_ratio_high=high,
        wins=int((d < 0).sum()),
        ties=int((d == 0).sum()),
        losses=int((d > 0).sum()),
        p=float(wilcoxon(d).pvalue) if d.any() else 1.0,
    )


def _interval(
    d: Float[np.ndarray, " S"], rng: np.random.Generator
) -> tuple[float, float] | tuple[None, None]:
    """Return the bootstrap interval of the median of `d`; None for a single value."""
    if len(d) < 2:
        return None, None
    interval = bootstrap(
        (d,), np.median, n_resamples=_PAIRED, confidence_level=CONFIDENCE, method="percentile", rng=rng
    ).confidence_interval
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


def geometric_mean(loops: Loops, *, rng: np.random.Generator) -> MeanEstimate:
    """Return the geometric mean of worth, in which every loop counts the same.

    Args:
        loops: Worth by loop and seed, one loop or more with one seed or more each.
        rng: Generator of the resamples: seeds are drawn with replacement within each loop
            (percentile method).

    Raises:
        SettingsError: If there is no loop, or a loop without seeds.
    """
    logs = [np.log(worth) for worth in _checked(loops)]
    means = [_counts(len(values), rng) @ values / len(values) for values in logs]
    value = float(np.exp(np.mean([values.mean() for values in logs])))
    return _estimate(value, np.exp(np.mean(means, axis=0)), loops)


def mean_of(found: Mapping[Pair, float]) -> MeanEstimate | None:
    """Return the geometric mean over loops, each counting the same; None without studies.

    The interval is a bootstrap over the seeds of each loop.
    """
    by_loop: dict[str, list[float]] = {}
    for (loop, _), value in sorted(found.items()):
        by_loop.setdefault(loop, []).append(value)
    loops = [np.array(values) for values in by_loop.values()]
    return geometric_mean(loops, rng=np.random.default_rng(0)) if loops else None


def ratio_of(ours: Mapping[Pair, float], theirs: Mapping[Pair, float]) -> MeanEstimate | None:
    """Return the geometric mean of the ratio, in pairs of one loop and seed."""
    return mean_of({pair: ours[pair] / theirs[pair] for pair in ours if pair in theirs})


def interquartile_mean(loops: Loops) -> float:
    """Return the geometric mean of the middle half of all studies.

    Source: Agarwal et al. (2021), Deep reinforcement learning at the edge of the statistical
    precipice. Deviation: of the logarithms.
    """
    return float(np.exp(trim_mean(np.log(np.concatenate(list(_checked(loops)))), 0.25)))


def improvement(ours: Loops, theirs: Loops, *, rng: np.random.Generator) -> MeanEstimate:
    """Return the probability that one agent's worth exceeds another's on a loop drawn at random.

    It is the mean over the loops of the share of pairs of seeds in which `ours` is higher; a tie
    counts half. Seeds need not be paired.

    Source: Agarwal et al. (2021).

    Args:
        ours: Worth of the agent by loop and seed.
        theirs: Worth of the other agent on the same loops, with seeds of any number.
        rng: Generator of the resamples, see `geometric_mean`; both agents' seeds are resampled.

    Raises:
        SettingsError: If the numbers of loops differ, or there is no loop or a loop without seeds.
    """
    if len(ours) != len(theirs):
        raise SettingsError(f"both agents need the same loops, got {len(ours)} and {len(theirs)}")
    values, means = [], []
    for a, b in zip(_checked(ours), _checked(theirs), strict=True):
        wins = (a[:, None] > b) + 0.5 * (a[:, None] == b)
        values.append(wins.mean())
        drawn_a, drawn_b = _counts(len(a), rng), _counts(len(b), rng)
        means.append(((drawn_a @ wins) * drawn_b).sum(axis=1) / wins.size)
    return _estimate(float(np.mean(values)), np.mean(means, axis=0), [*ours, *theirs])


def drift(curves: Iterable[Float[np.ndarray, " _"]]) -> float:
    """Return how many times less a θ is worth at the end of a study than the best one held before.

    It is the geometric mean over the studies of (highest worth along the study) / (worth at its
    end); 1 means that nothing was lost.

    Args:
        curves: Worth of the θ that the agent would return, along each study; one or more.
    """
    return float(np.exp(np.mean([np.log(curve.max() / curve[-1]) for curve in curves])))


def random_search(count: int) -> float:
    """Return the geometric mean of the worth of the best of `count` random θ, in theory.

    It is exp(1 + 1/2 + ... + 1/count), which holds for a pool without end: 36.5 for 20, 90 for 50.
    """
    return float(np.exp(np.sum(1 / np.arange(1, count + 1))))


def _checked(loops: Loops) -> Loops:
    if not len(loops) or not all(len(worth) for worth in loops):
        raise SettingsError("worth must come from one loop or more, with one seed or more each")
    return loops


def _counts(seeds: int, rng: np.random.Generator) -> Int[np.ndarray, "R S"]:
    """Return how often each seed is in each resample."""
    drawn = rng.integers(seeds, size=(_RESAMPLES, seeds))
    places = drawn + seeds * np.arange(_RESAMPLES)[:, None]
    return np.bincount(places.ravel(), minlength=_RESAMPLES * seeds).reshape(_RESAMPLES, seeds)


def _estimate(value: float, resampled: Float[np.ndarray, " R"], loops: Loops) -> MeanEstimate:
    if max(len(worth) for worth in loops) < 2:
        return MeanEstimate(value, None, None)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(resampled, [tail, 1 - tail])
    return MeanEstimate(value, float(low), float(high))
