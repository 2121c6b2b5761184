"""Statistics of worth over loops and seeds, on a logarithmic scale, with their uncertainty."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import SettingsError

CONFIDENCE = 0.95
RESAMPLES = 2000
"""Number of bootstrap resamples; the ends of an interval then vary by about 2 % of its length."""
Loops = Sequence[Float[np.ndarray, " _"]]
"""Worth of the studies of an agent, with an array over the seeds for each loop."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % bootstrap interval, which is None if no loop has two seeds."""

    value: float
    low: float | None
    high: float | None


def geometric_mean(loops: Loops, *, rng: np.random.Generator) -> Estimate:
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


def interquartile_mean(loops: Loops) -> float:
    """Return the geometric mean of the middle half of all studies.

    Source: Agarwal et al. (2021), Deep reinforcement learning at the edge of the statistical
    precipice. Deviation: of the logarithms.
    """
    from scipy.stats import trim_mean

    return float(np.exp(trim_mean(np.log(np.concatenate(list(_checked(loops)))), 0.25)))


def improvement(ours: Loops, theirs: Loops, *, rng: np.random.Generator) -> Estimate:
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
    drawn = rng.integers(seeds, size=(RESAMPLES, seeds))
    places = drawn + seeds * np.arange(RESAMPLES)[:, None]
    return np.bincount(places.ravel(), minlength=RESAMPLES * seeds).reshape(RESAMPLES, seeds)


def _estimate(value: float, resampled: Float[np.ndarray, " R"], loops: Loops) -> Estimate:
    if max(len(worth) for worth in loops) < 2:
        return Estimate(value, None, None)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(resampled, [tail, 1 - tail])
    return Estimate(value, float(low), float(high))
