"""What a person may want from a closed loop: random orders of its KPIs, and random trade-offs.

Source: none. Half of the draws are orders of some KPIs, each with a limit or none below which all
values are equally good, and with a just noticeable difference: the first KPI that differs
noticeably decides. The others are trade-offs: the cost of one KPI is Hill's function of its
distance to a good value (for small exponents ratios count, for large ones there is a limit at the
scale, and beyond the scale returns diminish), weights have heavy tails, and the total has a just
noticeable difference. In both, stated limits come first, unless the draw is one of few that ignore
them. A difference of two costs above 1 is noticed.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit, ndtr

from .bank import Bank

_SPREADS = (0.5, 1.5, 3.0)
"""Standard deviations of the logarithm of a weight: from all alike to one before all others."""
_EXPONENTS = (-1.0, 2.5)
"""Binary logarithms of the smallest and the largest exponent."""
_DEEPEST = 2.5
"""Half of the scales lie among the best values of a KPI, down to its quantile 10^-2.5."""
_LARGEST = 0.8
"""Quantile of the largest scale."""
_UNLIMITED = 0.5
"""Share of the KPIs in an order that have no limit."""
_STEPS = (-2.5, -0.3)
"""Decimal logarithms of the smallest and the largest just noticeable difference of a KPI in an
order, in its range over random θ."""
_NOTICED = (-3.5, -0.8)
"""The same of a trade-off, whose cost lies between 0 and 1."""
_RESPECTED = 0.97
"""Share of draws in which stated limits come first."""
ERRORS = ((0.02, 0.7), (0.1, 0.2), (0.25, 0.1))
"""Rates of wrong answers, and how probable each is."""
_LEVELS, _MOST = 512, 5
"""Number of levels of a KPI in an order, and of KPIs in it: sums of them are exact integers."""
_FIRST, _BEYOND = 2.0**20, 255
"""Weight of a step beyond a stated limit in a trade-off, and the most steps that count."""
_SHARP = 3.0
"""How fast noticing becomes certain, in inverse just noticeable differences."""
_FAR, _ROUNDED = 1e9, 1e-9
"""Largest number of steps, and what rounding may add to a value at its limit."""
_HUGE = 1e100
_FLOOR = 0.002
"""Distances below this share of the median distance count as zero."""


@dataclass(frozen=True, eq=False, slots=True)
class Scale:
    """How the KPIs of a bank are measured: by the logarithm of the distance to a good value.

    Args:
        names: KPIs that differ in the bank.
        good: Good value of each, shape (k,): 0, or the best one if it can be negative.
        floor: Smallest distance that counts, shape (k,).
        quantiles: Quantiles 0, 0.001, ..., 1 of the log distances, shape (1001, k).
        ranges: Range of the distances, from their quantile 0.02 to 0.8, shape (k,).
        limits: Largest distance that meets the objective, infinite without one, shape (k,).
    """

    names: tuple[str, ...]
    good: Float[np.ndarray, " k"]
    floor: Float[np.ndarray, " k"]
    quantiles: Float[np.ndarray, "q k"]
    ranges: Float[np.ndarray, " k"]
    limits: Float[np.ndarray, " k"]

    @classmethod
    def of(
        cls, bank: Bank, spread: Int[np.ndarray, " r"], limits: Mapping[str, float] = MappingProxyType({})
    ) -> "Scale":
        """Return the scale for the KPIs of `bank`, whose rows `spread` fill the space.

        `limits` are the largest values that meet stated objectives, by the name of the KPI.
        """
        kpis = _bounded(bank.kpis)
        usual = [column[np.isfinite(column)] for column in kpis[spread].T]
        columns = [j for j, c in enumerate(usual) if len(c) and c.min() < c.max()]
        good = np.array([min(kpis[:, j].min(), 0.0) for j in columns])
        floor, quantiles = np.ones(len(columns)), np.zeros((1001, len(columns)))
        ranges = np.ones(len(columns))
        for place, j in enumerate(columns):
            distances = usual[j] - good[place]
            floor[place] = max(_FLOOR * np.median(distances[distances > 0]), 1.0 / _HUGE)
            logs = np.log(np.maximum(distances, floor[place]))
            quantiles[:, place] = np.quantile(logs, np.linspace(0, 1, 1001))
            ranges[place] = np.subtract(*np.quantile(distances, [0.8, 0.02])) or np.ptp(distances)
        names = tuple(bank.names[j] for j in columns)
        stated = np.array([limits.get(name, np.inf) for name in names]) - good
        return cls(names, good, floor, quantiles, ranges, stated)

    def __call__(
        self, bank: Bank, rows: Sequence[int] | Int[np.ndarray, " m"] | None = None
    ) -> Float[np.ndarray, "m k"]:
        """Return the log distances of all KPIs, shape (m, k), infinite where a KPI is.

        Args:
            bank: Bank with these KPIs.
            rows: Rows of the bank; None for all.
        """
        columns = [bank.names.index(name) for name in self.names]
        kpis = bank.kpis if rows is None else bank.kpis[list(rows)]
        distances = _bounded(kpis[:, columns]) - self.good
        return np.asarray(np.log(np.maximum(distances, self.floor)))

    def at(self, share: Float[np.ndarray, "s k"]) -> Float[np.ndarray, "s k"]:
        """Return the log distance that a share of random θ, below 1, does not exceed, (s, k)."""
        place = share * (len(self.quantiles) - 1)
        below, kpi = place.astype(np.int64), np.arange(share.shape[1])
        low, high = self.quantiles[below, kpi], self.quantiles[below + 1, kpi]
        return np.asarray(low + (place - below) * (high - low))


def _bounded(kpis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
    """Return `kpis` within what can be subtracted; the worst value, infinity, stays."""
    return np.asarray(np.where(np.isposinf(kpis), np.inf, np.clip(kpis, -_HUGE, _HUGE)))


@dataclass(frozen=True, eq=False, slots=True)
class Utilities:
    """Draws of what a person may want: s costs of k KPIs.

    Args:
        scales: Logarithm of the distance at which half of a KPI's weight is lost, or of the limit
            in an order, shape (s, k).
        exponents: Exponent of each KPI, shape (s, k).
        steps: Just noticeable difference of each KPI, shape (s, k).
        limits: Largest distance of each KPI that is allowed; infinite if none is stated, or if the
            draw ignores it, shape (s, k).
        normals: Standard normal numbers behind the weights; the largest one comes first, (s, k).
        spreads: Standard deviation of the logarithm of the weights, shape (s,).
        noticed: Just noticeable difference of the total, shape (s,).
        ordered: Number of KPIs in the order; 0 for a trade-off, shape (s,).
        errors: Rate of wrong answers, shape (s,).
    """

    scales: Float[np.ndarray, "s k"]
    exponents: Float[np.ndarray, "s k"]
    steps: Float[np.ndarray, "s k"]
    limits: Float[np.ndarray, "s k"]
    normals: Float[np.ndarray, "s k"]
    spreads: Float[np.ndarray, " s"]
    noticed: Float[np.ndarray, " s"]
    ordered: Int[np.ndarray, " s"]
    errors: Float[np.ndarray, " s"]

    @classmethod
    def drawn(
        cls, scale: Scale, count: int, rng: np.random.Generator, ordered: Bool[np.ndarray, " s"] | None = None
    ) -> "Utilities":
        """Return `count` draws before any answer is known.

        `ordered` says which of them are orders, shape (count,); None for the first half.
        """
        shape = (count, len(scale.names))
        deep = _LARGEST * 10.0 ** rng.uniform(-_DEEPEST, 0.0, shape)
        share = np.where(rng.random(shape) < 0.5, deep, rng.uniform(0.0, _LARGEST, shape))
        scales = scale.at(share)
        ordered = np.arange(count) < count // 2 if ordered is None else ordered
        free = ordered[:, None] & (rng.random(shape) < _UNLIMITED)
        rates, odds = zip(*ERRORS, strict=True)
        return cls(
            np.where(free, -np.inf, scales),
            2.0 ** rng.uniform(*_EXPONENTS, shape),
            scale.ranges * 10.0 ** rng.uniform(*_STEPS, shape),
            np.where(rng.random((count, 1)) < _RESPECTED, scale.limits, np.inf) * np.ones(shape),
            rng.standard_normal(shape),
            rng.choice(_SPREADS, count),
            10.0 ** rng.uniform(*_NOTICED, count),
            ordered * rng.integers(1, max(min(shape[1], _MOST), 1) + 1, count),
            rng.choice(rates, count, p=odds),
        )

    def __len__(self) -> int:
        return len(self.errors)

    @property
    def weights(self) -> Float[np.ndarray, "s c"]:
        """Return the weight of each KPI, and of being beyond its stated limit, shape (s, 2k)."""
        logs = self.spreads[:, None] * self.normals
        # Only ratios count: without subtracting the largest, a wide spread would overflow.
        raw = np.exp(logs - logs.max(axis=1, keepdims=True, initial=-np.inf))
        # In units of what is just noticed, so that a difference of 1 is noticed by every draw alike.
        shares = raw / (raw.sum(axis=1) * self.noticed)[:, None]
        ranks = np.argsort(np.argsort(-self.normals, axis=1), axis=1)
        ordered = self.ordered[:, None]
        # A lexicographic order as a sum: one level of a KPI outweighs all levels of the later ones.
        steps = np.where(ranks < ordered, 2.0 * float(_LEVELS) ** (_MOST - 1 - ranks), 0.0)
        first = np.where(ordered > 0, 2.0 * _LEVELS**_MOST, _FIRST) * np.ones(logs.shape)
        return np.hstack([np.where(ordered > 0, steps, shares), first])

    def level(
        self,
        logs: Float[np.ndarray, "*s m k"],
        part: int | Int[np.ndarray, " q"],
        draws: Int[np.ndarray, " q"] | None = None,
    ) -> Float[np.ndarray, "q m"]:
        """Return how poor a KPI is, or how far beyond its stated limit, shape (q, m).

        It is a share of the weight in a trade-off, and otherwise in just noticeable differences.

        Args:
            logs: Log distances of m experiments, shape (m, k), or in each draw, shape (s, m, k).
            part: Column of the KPI, plus k for its stated limit; one for each draw, shape (q,).
            draws: Draws, shape (q,); None for all.
        """
        rows = np.arange(len(self)) if draws is None else draws
        kpi = np.broadcast_to(np.asarray(part) % logs.shape[-1], rows.shape)
        x = logs[rows, :, kpi] if logs.ndim > 2 else logs.T[kpi]
        beyond = np.broadcast_to(np.asarray(part) >= logs.shape[-1], rows.shape)
        order = (self.ordered[rows] > 0) & ~beyond
        trade = ~order & ~beyond
        found = np.zeros(x.shape)
        scales, steps = self.scales[rows, kpi, None], self.steps[rows, kpi, None]
        exponents, limits = self.exponents[rows, kpi, None], self.limits[rows, kpi, None]
        # s^p / (s^p + d^p) in logarithms, the share of the weight that is lost at the distance d.
        found[trade] = expit(exponents[trade] * (x[trade] - scales[trade]))
        above = np.exp(np.maximum(x[order], scales[order])) - np.exp(scales[order])
        # Below `scales` all values are alike; above, distances count in just noticeable differences.
        found[order] = np.minimum(above / steps[order], _FAR)
        beyond = beyond & np.isfinite(limits[:, 0])
        excess = np.exp(x[beyond]) * (1 - _ROUNDED) - limits[beyond]
        found[beyond] = np.clip(np.ceil(excess / steps[beyond]), 0, _BEYOND)
        return found

    def costs(self, logs: Float[np.ndarray, "*s m k"]) -> Float[np.ndarray, "s m"]:
        """Return the cost of m experiments in each draw, shape (s, m).

        Their log distances have the shape (m, k), or (s, m, k) if each draw has its own.
        """
        found, weights = np.zeros((len(self), logs.shape[-2])), self.weights
        order = self.ordered > 0
        for part in self.parts:
            level = self.level(logs, part)
            if part < logs.shape[-1]:
                # Whole levels, too few to reach the weight of the KPI before.
                level[order] = np.minimum(np.floor(level[order]), _LEVELS - 1)
            found += weights[:, part, None] * level
        return found

    def levels(self, logs: Float[np.ndarray, "p k"]) -> Float[np.ndarray, "c s p"]:
        """Return all levels of p experiments by their log distances, shape (2k, s, p)."""
        found = np.zeros((2 * logs.shape[1], len(self), len(logs)))
        for part in self.parts:
            found[part] = self.level(logs, part)
        return found

    def gains(
        self, levels: Float[np.ndarray, "c s p"], better: Int[np.ndarray, " a"], worse: Int[np.ndarray, " a"]
    ) -> Float[np.ndarray, "c s a"]:
        """Return how much better one experiment is than another by each part, shape (2k, s, a).

        In an order, the first KPI decides whose difference is noticeable: that of two experiments,
        while `costs` counts steps from the best value, as an order of all experiments needs.

        Args:
            levels: Levels of p experiments, see `levels`, shape (2k, s, p).
            better: One experiment of each pair, shape (a,).
            worse: The other one, shape (a,).
        """
        found = levels.take(worse, axis=2) - levels.take(better, axis=2)
        own, order = found[: len(found) // 2], self.ordered > 0
        # Only whether a difference is noticed: a large one must not outweigh an earlier KPI.
        own[:, order] = np.clip(np.trunc(own[:, order]), -1, 1)
        return np.asarray(found * self.weights.T[:, :, None])

    def log_answers(
        self,
        levels: Float[np.ndarray, "c s p"],
        better: Int[np.ndarray, " a"],
        worse: Int[np.ndarray, " a"],
        tie: Bool[np.ndarray, " a"],
    ) -> Float[np.ndarray, "s a"]:
        """Return the logarithm of the probability of each answer by each draw, shape (s, a).

        Args:
            levels: Levels of p experiments, see `levels`, shape (2k, s, p).
            better: The preferred experiment of each answer, or one of a tie, shape (a,).
            worse: The other one, shape (a,).
            tie: Whether the answer is that they are alike, shape (a,).
        """
        gain = self.gains(levels, better, worse).sum(axis=0)
        won, lost = noticed(gain), noticed(-gain)
        explained = np.where(tie, 1.0 - won - lost, won)
        # A mistake is any of the three answers, so that no single one can rule out a draw.
        error = self.errors[:, None]
        return np.asarray(np.log((1.0 - error) * explained + error / 3.0))

    @property
    def parts(self) -> Iterable[int]:
        """Return what a cost is the sum of, by number: each KPI, and each stated limit."""
        stated = np.isfinite(self.limits).any(axis=0)
        return (*range(len(stated)), *(len(stated) + np.flatnonzero(stated)).tolist())

    def take(self, rows: Int[np.ndarray, " r"]) -> "Utilities":
        """Return the draws in `rows`, shape (r,)."""
        return Utilities(*(getattr(self, f.name)[rows] for f in fields(self)))

    def where(self, mask: Bool[np.ndarray, " s"], other: "Utilities") -> "Utilities":
        """Return these draws, and those of `other` where `mask` holds, shape (s,)."""
        rows = np.arange(len(self)) + len(self) * mask
        both = (np.concatenate([getattr(u, f.name) for u in (self, other)]) for f in fields(self))
        return Utilities(*(values[rows] for values in both))

    def mutated(self, other: "Utilities", rng: np.random.Generator) -> "Utilities":
        """Return other draws to try: in each, one KPI or what is common is drawn again.

        Weights take a step that keeps their distribution; the rest comes from `other`, new draws
        with the same ones ordered.
        """
        count, k = self.normals.shape
        part = rng.integers(0, k + 2, count)[:, None]
        kpi, what = part == np.arange(k), rng.integers(0, 3, (count, 1))
        step = np.where(
            (rng.random((count, 1)) < 0.5) & (part < k),
            other.normals,
            0.8 * self.normals + 0.6 * other.normals,
        )
        weight, shape = (kpi & (what != 1)) | (part == k), kpi & (what != 0)
        masks = {"scales": shape, "exponents": shape, "steps": shape}
        common = (part == k + 1)[:, 0]
        masks |= dict.fromkeys(("spreads", "noticed", "ordered", "errors"), common)
        taken = {
            name: np.where(mask, getattr(other, name), getattr(self, name)) for name, mask in masks.items()
        }
        return replace(self, normals=np.where(weight, step, self.normals), **taken)


def noticed(gain: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return how probably a difference of costs is noticed."""
    return np.asarray(ndtr(_SHARP * (gain - 1.0)))
