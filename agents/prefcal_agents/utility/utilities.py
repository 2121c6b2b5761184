"""What a person may want from a closed loop: random trade-offs between its KPIs.

Source: none. The cost of one KPI is Hill's function of its distance to a good value: for small
exponents ratios count, for large ones there is a limit at the scale, and beyond the scale returns
diminish. Weights have heavy tails, so one KPI may come before all others.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit

from .bank import Bank

_SPREADS = (0.5, 1.5, 3.0)
"""Standard deviations of the logarithm of a weight: from all alike to one before all others."""
_EXPONENTS = (-1.0, 2.5)
"""Binary logarithms of the smallest and the largest exponent."""
_DEEPEST = 2.5
"""Half of the scales lie among the best values of a KPI, down to its quantile 10^-2.5."""
_LARGEST = 0.8
"""Quantile of the largest scale."""
ERRORS = ((0.01, 0.8), (0.1, 0.1), (0.2, 0.1))
"""Rates of wrong answers, and how probable each is."""
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
    """

    names: tuple[str, ...]
    good: Float[np.ndarray, " k"]
    floor: Float[np.ndarray, " k"]
    quantiles: Float[np.ndarray, "q k"]

    @classmethod
    def of(cls, bank: Bank, spread: Int[np.ndarray, " r"]) -> "Scale":
        """Return the scale for the KPIs of `bank`, whose rows `spread` fill the space."""
        kpis = _bounded(bank.kpis)
        usual = [column[np.isfinite(column)] for column in kpis[spread].T]
        columns = [j for j, c in enumerate(usual) if len(c) and c.min() < c.max()]
        good = np.array([min(kpis[:, j].min(), 0.0) for j in columns])
        floor, quantiles = np.ones(len(columns)), np.zeros((1001, len(columns)))
        for place, j in enumerate(columns):
            distances = usual[j] - good[place]
            floor[place] = max(_FLOOR * np.median(distances[distances > 0]), 1.0 / _HUGE)
            logs = np.log(np.maximum(distances, floor[place]))
            quantiles[:, place] = np.quantile(logs, np.linspace(0, 1, 1001))
        return cls(tuple(bank.names[j] for j in columns), good, floor, quantiles)

    def __call__(self, bank: Bank, rows: Sequence[int] | None = None) -> Float[np.ndarray, "m k"]:
        """Return the log distances of all KPIs, shape (m, k), infinite where a KPI is.

        Args:
            bank: Bank with these KPIs.
            rows: Rows of the bank; None for all.
        """
        columns = [bank.names.index(name) for name in self.names]
        kpis = bank.kpis if rows is None else bank.kpis[list(rows)]
        distances = _bounded(kpis[:, columns]) - self.good
        return np.asarray(np.log(np.maximum(distances, self.floor)))


def _bounded(kpis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
    """Return `kpis` within what can be subtracted; the worst value, infinity, stays."""
    return np.asarray(np.where(np.isposinf(kpis), np.inf, np.clip(kpis, -_HUGE, _HUGE)))


@dataclass(frozen=True, eq=False, slots=True)
class Utilities:
    """Draws of what a person may want: s costs, each a weighted sum over k KPIs.

    Args:
        scales: Logarithm of the distance at which half of a KPI's weight is lost, shape (s, k).
        exponents: Exponent of each KPI, shape (s, k).
        normals: Standard normal numbers behind the weights, shape (s, k).
        spreads: Standard deviation of the logarithm of the weights, shape (s,).
        errors: Rate of wrong answers, shape (s,).
    """

    scales: Float[np.ndarray, "s k"]
    exponents: Float[np.ndarray, "s k"]
    normals: Float[np.ndarray, "s k"]
    spreads: Float[np.ndarray, " s"]
    errors: Float[np.ndarray, " s"]

    @classmethod
    def drawn(cls, scale: Scale, count: int, rng: np.random.Generator) -> "Utilities":
        """Return `count` draws before any answer is known."""
        shape = (count, len(scale.names))
        deep = _LARGEST * 10.0 ** rng.uniform(-_DEEPEST, 0.0, shape)
        share = np.where(rng.random(shape) < 0.5, deep, rng.uniform(0.0, _LARGEST, shape))
        grid = np.linspace(0.0, 1.0, len(scale.quantiles))
        scales = [np.interp(share[:, j], grid, q) for j, q in enumerate(scale.quantiles.T)]
        rates, odds = zip(*ERRORS, strict=True)
        return cls(
            np.array(scales).T.reshape(shape),
            2.0 ** rng.uniform(*_EXPONENTS, shape),
            rng.standard_normal(shape),
            rng.choice(_SPREADS, count),
            rng.choice(rates, count, p=odds),
        )

    def __len__(self) -> int:
        return len(self.errors)

    @property
    def weights(self) -> Float[np.ndarray, "s k"]:
        """Return the weight of each KPI, shape (s, k); rows add up to 1."""
        logs = self.spreads[:, None] * self.normals
        if not logs.shape[1]:
            return np.asarray(logs)
        raw = np.exp(logs - logs.max(axis=1, keepdims=True))
        return np.asarray(raw / raw.sum(axis=1, keepdims=True))

    def losses(self, logs: Float[np.ndarray, "*s m k"], kpi: int) -> Float[np.ndarray, "s m"]:
        """Return how much of the weight of KPI number `kpi` is lost, from 0 to 1, shape (s, m).

        Args:
            logs: Log distances of m experiments, shape (m, k), or in each draw, shape (s, m, k).
            kpi: Column of the KPI.
        """
        steps = logs[..., kpi] - self.scales[:, kpi, None]
        return np.asarray(expit(self.exponents[:, kpi, None] * steps))

    def costs(self, logs: Float[np.ndarray, "*s m k"]) -> Float[np.ndarray, "s m"]:
        """Return the cost of m experiments in each draw, from 0 to 1, shape (s, m).

        Their log distances have the shape (m, k), or (s, m, k) if each draw has its own.
        """
        total = np.zeros((len(self), logs.shape[-2]))
        return self.added(total, (self.losses(logs, kpi) for kpi in range(logs.shape[-1])))

    def added(
        self, total: Float[np.ndarray, "s m"], losses: Iterable[Float[np.ndarray, "s m"]]
    ) -> Float[np.ndarray, "s m"]:
        """Return `total` after adding the weighted `losses` of each KPI to it, shape (s, m)."""
        for weight, lost in zip(self.weights.T, losses, strict=True):
            total += weight[:, None] * lost
        return total

    def take(self, rows: Int[np.ndarray, " r"]) -> "Utilities":
        """Return the draws in `rows`, shape (r,)."""
        return Utilities(*(getattr(self, f.name)[rows] for f in fields(self)))

    def where(self, mask: Bool[np.ndarray, " s"], other: "Utilities") -> "Utilities":
        """Return these draws, and those of `other` where `mask` holds, shape (s,)."""
        rows = np.arange(len(self)) + len(self) * mask
        both = (np.concatenate([getattr(u, f.name) for u in (self, other)]) for f in fields(self))
        return Utilities(*(values[rows] for values in both))

    def mutated(self, other: "Utilities", rng: np.random.Generator) -> "Utilities":
        """Return other draws to try: in each, one KPI or one common number is drawn again.

        Weights take a step that keeps their distribution; the rest comes from `other`, new draws.
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
        common = (part == k + 1)[:, 0]
        return replace(
            self,
            normals=np.where(weight, step, self.normals),
            scales=np.where(shape, other.scales, self.scales),
            exponents=np.where(shape, other.exponents, self.exponents),
            spreads=np.where(common, other.spreads, self.spreads),
            errors=np.where(common, other.errors, self.errors),
        )
