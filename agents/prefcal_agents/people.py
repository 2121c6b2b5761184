"""What a person may want from KPIs, what answers say of it, and which θ is worth showing."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit, logsumexp, ndtr, softmax

from prefcal_env.preferences.answer import Preference, Reading
from prefcal_env.preferences.history import History, KPIValues

from .lessons import Preferences
from .surrogate import latest, matern, predicted, squares


@dataclass(frozen=True, eq=False, slots=True)
class Bank:
    """θ and their KPIs, in the order simulated or run.

    Args:
        z: Points of the unit cube, shape (m, n).
        thetas: θ, physical, shape (m, n).
        names: Names of the KPIs.
        kpis: KPIs, lower is better; infinite where one is missing, shape (m, k).
        failed: Whether each simulation failed: it has no KPI at all, shape (m,).
    """

    z: Float[np.ndarray, "m n"]
    thetas: Float[np.ndarray, "m n"]
    names: tuple[str, ...]
    kpis: Float[np.ndarray, "m k"]
    failed: Bool[np.ndarray, " m"]

    def __post_init__(self) -> None:
        for array in (self.z, self.thetas, self.kpis, self.failed):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.z)

    @classmethod
    def of(cls, z: Float[np.ndarray, "m n"], thetas: Float[np.ndarray, "m n"], table: KPIValues) -> "Bank":
        """Return the bank of m simulated θ; a KPI that an experiment lacks is infinite.

        Of rows with the same θ, which rounding of knobs gives, only the first is kept.

        Args:
            z: Points of the unit cube, shape (m, n).
            thetas: θ, physical, shape (m, n).
            table: KPIs of the m experiments.
        """
        _, first = np.unique(thetas + 0.0, axis=0, return_index=True)  # -0.0 is 0.0
        first.sort()
        kpis = table.values[first]
        known = ~np.isnan(kpis).all(axis=0)
        names = tuple(name for name, told in zip(table.names, known, strict=True) if told)
        kpis = np.compress(known, kpis, axis=1)
        unknown = np.isnan(kpis)
        failed = np.asarray(unknown.all(axis=1))
        return cls(z[first], thetas[first], names, np.where(unknown, np.inf, kpis), failed)

    @property
    def hopeless(self) -> Bool[np.ndarray, " m"]:
        """Return which θ have no finite KPI, shape (m,): they failed, or were interrupted."""
        return np.asarray(np.isinf(self.kpis).all(axis=1))

    def has_all(self, thetas: Float[np.ndarray, "p n"]) -> bool:
        """Return whether all of p physical θ were simulated."""
        return {*_keys(thetas)} <= {*_keys(self.thetas)}

    def find(self, theta: Sequence[float] | Float[np.ndarray, " n"]) -> int:
        """Return the row of a physical θ. Raises KeyError if it was not simulated."""
        return int(self.rows([theta])[0])

    def rows(self, thetas: Sequence[Sequence[float] | Float[np.ndarray, " n"]]) -> Int[np.ndarray, " p"]:
        """Return the rows of p physical θ, shape (p,). Raises KeyError if one was not simulated."""
        if not len(thetas):
            return np.zeros(0, dtype=np.int64)
        known = dict(zip(_keys(self.thetas), range(len(self.thetas)), strict=True))
        found = list(map(known.get, _keys(np.array(thetas, dtype=float))))
        if None in found:
            raise KeyError(tuple(thetas[found.index(None)]))
        return np.array(found, dtype=np.int64)


def _keys(thetas: Float[np.ndarray, "m n"]) -> list[bytes]:
    """Return the bytes of each of m θ, as `theta_keys` does in four times the time; -0.0 + 0.0 is 0.0."""
    found: list[bytes] = (thetas + 0.0).view(f"V{thetas.shape[1] * thetas.itemsize}").ravel().tolist()
    return found


# --- What a person may want from a closed loop: random orders of its KPIs, and random trade-offs.
#
# Source: none. Half of the draws are orders of some KPIs, each with a limit or none below which all
# values are equally good, and with a just noticeable difference: the first KPI that differs noticeably
# decides. The others are trade-offs: the cost of one KPI is Hill's function of its distance to a good
# value (for small exponents ratios count, for large ones there is a limit at the scale, and beyond the
# scale returns diminish), weights have heavy tails, and the total has a just noticeable difference. In
# both, stated limits come first, unless the draw is one of few that ignore them. A difference of two
# costs above 1 is noticed.

_LEVELS, _MOST = 512, 5  # levels of a KPI in an order, and KPIs in it: sums of them are exact integers
_HUGE = 1e100


@dataclass(frozen=True, eq=False, slots=True)
class Scale:
    """How the KPIs of a bank are measured: by the logarithm of the distance to a good value.

    Screening, rule 3.

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
        # The good value is that of the whole bank, or a leader would lie beyond it; scales are those of
        # random θ alone, since θ near leaders crowd where values are good.
        kpis = _bound(bank.kpis)
        usual = [column[np.isfinite(column)] for column in kpis[spread].T]
        columns = [j for j, c in enumerate(usual) if len(c) and c.min() < c.max()]
        good = np.array([min(kpis[:, j].min(), 0.0) for j in columns])
        floor, quantiles = np.ones(len(columns)), np.zeros((1001, len(columns)))
        ranges = np.ones(len(columns))
        for place, j in enumerate(columns):
            distances = usual[j] - good[place]
            # Below 0.002 of the median, distances count as zero: their logarithms would run away.
            floor[place] = max(0.002 * np.median(distances[distances > 0]), 1.0 / _HUGE)
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
        return self.logs(kpis[:, columns])

    def logs(self, kpis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """Return the log distances of KPIs in the order of `names`, shape (m, k)."""
        return np.asarray(np.log(np.maximum(_bound(kpis) - self.good, self.floor)))

    def at(self, share: Float[np.ndarray, "s k"]) -> Float[np.ndarray, "s k"]:
        """Return the log distance that a share of random θ, below 1, does not exceed, (s, k)."""
        place = share * (len(self.quantiles) - 1)
        below, kpi = place.astype(np.int64), np.arange(share.shape[1])
        low, high = self.quantiles[below, kpi], self.quantiles[below + 1, kpi]
        return np.asarray(low + (place - below) * (high - low))


def _bound(kpis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
    """Return `kpis` within what can be subtracted; the worst value, infinity, stays."""
    return np.asarray(np.where(np.isposinf(kpis), np.inf, np.clip(kpis, -_HUGE, _HUGE)))


Mistakes = tuple[tuple[float, float], ...]
"""Rates of answers that do not follow from the KPIs, and how probable each is before any answer is known."""
REAL: Mistakes = ((0.02, 0.25), (0.1, 0.25), (0.3, 0.25), (0.6, 0.25))
"""Real people: some follow their KPIs, others hardly do. Draws that all but exclude the latter believe
themselves too much (docs/research/people.md)."""
SURE: Mistakes = ((0.02, 0.7), (0.1, 0.2), (0.25, 0.1))
"""People who follow their KPIs: for an agent that compares them with θ, and leaves KPIs that mislead later
if an answer may as well be a whim."""


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
        errors: Rate of answers that do not follow from the KPIs, shape (s,).
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
    def draw(
        cls,
        scale: Scale,
        count: int,
        rng: np.random.Generator,
        ordered: Bool[np.ndarray, " s"] | None = None,
        mistakes: Mistakes = REAL,
    ) -> "Utilities":
        """Return `count` draws before any answer is known (Screening, rule 4).

        `ordered` says which of them are orders, shape (count,); None for the first half.
        """
        shape = (count, len(scale.names))
        # Uniform quantiles alone would hardly ever put a limit among the best percent, where late answers
        # are.
        deep = 0.8 * 10.0 ** rng.uniform(-2.5, 0.0, shape)
        share = np.where(rng.random(shape) < 0.5, deep, rng.uniform(0.0, 0.8, shape))
        scales = scale.at(share)
        ordered = np.arange(count) < count // 2 if ordered is None else ordered
        rates, odds = zip(*mistakes, strict=True)
        free = ordered[:, None] & (rng.random(shape) < 0.5)
        return cls(
            # Without a limit every value counts: a distance of 0 is where levels begin.
            np.where(free, -np.inf, scales),
            2.0 ** rng.uniform(-1.0, 2.5, shape),  # from nearly ratios alone to nearly a limit
            scale.ranges * 10.0 ** rng.uniform(-2.5, -0.3, shape),
            # With 0.9, ten answers are worth 204, not 384, on the overtaking: docs/research/screening.md.
            np.where(rng.random((count, 1)) < 0.97, scale.limits, np.inf) * np.ones(shape),
            rng.standard_normal(shape),
            rng.choice((0.5, 1.5, 3.0), count),  # from all alike to one before all others
            10.0 ** rng.uniform(-3.5, -0.8, count),  # of a total between 0 and 1
            # 0 for trade-offs. Without a KPI the range would be empty, which the generator refuses.
            ordered * rng.integers(1, max(min(shape[1], _MOST), 1) + 1, count),
            rng.choice(rates, count, p=odds),
        )

    def __len__(self) -> int:
        return len(self.errors)

    def to_bytes(self) -> bytes:
        """Return all numbers, to the last bit, which `of_bytes` reads."""
        return np.column_stack([getattr(self, f.name) for f in fields(self)]).tobytes()

    @classmethod
    def of_bytes(cls, content: bytes, kpis: int) -> "Utilities | None":
        """Return the draws that `to_bytes` returned; None if they are not `DRAWS` draws of `kpis` KPIs."""
        if len(content) != 8 * DRAWS * (5 * kpis + 4):
            return None
        numbers = np.frombuffer(content).reshape(DRAWS, -1)
        wide = [numbers[:, i * kpis : (i + 1) * kpis] for i in range(5)]
        spreads, noticed, ordered, errors = numbers[:, 5 * kpis :].T
        # Contiguous as they were: the order in memory decides how numpy adds, and so the last bit.
        parts = map(np.ascontiguousarray, [*wide, spreads, noticed, ordered.astype(np.int64), errors])
        return cls(*parts)

    @property
    def loose(self) -> Bool[np.ndarray, " s"]:
        """Return which draws hardly follow the KPIs, shape (s,): most answers are mistakes."""
        return np.asarray(self.errors >= REAL[-1][0])

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
        # A step beyond a stated limit outweighs all else, and 255 of them are still exact.
        first = np.where(ordered > 0, 2.0 * _LEVELS**_MOST, 2.0**20) * np.ones(logs.shape)
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
        x = logs[rows, :, kpi] if logs.ndim > 2 else logs.T[kpi if np.ndim(part) else kpi[:1]]
        beyond = np.broadcast_to(np.asarray(part) >= logs.shape[-1], rows.shape)
        order = (self.ordered[rows] > 0) & ~beyond
        scales, steps = self.scales[rows, kpi, None], self.steps[rows, kpi, None]
        exponents, limits = self.exponents[rows, kpi, None], self.limits[rows, kpi, None]
        found, shared = np.zeros((len(rows), logs.shape[-2])), len(x) != len(rows)  # whether by all draws
        # d^p / (s^p + d^p) in logarithms, the share of the weight that is lost at the distance d.
        traded = ~order & ~beyond
        share = (x if shared else x[traded]) - scales[traded]
        share *= exponents[traded]
        found[traded] = expit(share, out=share)
        # Below `scales` all values are alike; above, distances count in just noticeable differences.
        above = np.maximum(x if shared else x[order], scales[order])
        np.exp(above, out=above)
        above -= np.exp(scales[order])
        above /= steps[order]
        found[order] = np.minimum(above, 1e9, out=above)  # infinity times a weight of 0 is NaN
        beyond = beyond & np.isfinite(limits[:, 0])
        # A value at its limit keeps it, also where the logarithm and back added a last digit.
        excess = np.exp(x if shared else x[beyond]) * (1 - 1e-9) - limits[beyond]
        found[beyond] = np.clip(np.ceil(excess / steps[beyond]), 0, 255)
        return np.asarray(found)

    def costs(self, logs: Float[np.ndarray, "*s m k"]) -> Float[np.ndarray, "s m"]:
        """Return the cost of m experiments in each draw, shape (s, m): Screening, rule 7.

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

    def differences(
        self, levels: Float[np.ndarray, "c s p"], better: Int[np.ndarray, " a"], worse: Int[np.ndarray, " a"]
    ) -> Float[np.ndarray, "c s a"]:
        """Return how much better one experiment is than another by each part, in levels, (2k, s, a).

        In an order, the first KPI decides whose difference is noticeable: that of two experiments,
        while `costs` counts steps from the best value, as an order of all experiments needs.

        Args:
            levels: Levels of p experiments, see `levels`, shape (2k, s, p).
            better: One experiment of each pair, shape (a,).
            worse: The other one, shape (a,).
        """
        found, counted = np.zeros((*levels.shape[:2], len(better))), self.counted
        for part in self.parts:  # by the others nothing differs
            found[part] = _subtract(levels[part], better, worse, counted[part])
        return found

    @property
    def counted(self) -> Bool[np.ndarray, "c s"]:
        """Return where only the sign of a noticeable difference counts: KPIs of an order, (2k, s)."""
        own = np.arange(2 * self.normals.shape[1]) < self.normals.shape[1]
        return np.asarray(own[:, None] & (self.ordered > 0))

    def gains(
        self, levels: Float[np.ndarray, "c s p"], better: Int[np.ndarray, " a"], worse: Int[np.ndarray, " a"]
    ) -> Float[np.ndarray, "c s a"]:
        """Return `differences` weighted into costs, shape (2k, s, a)."""
        return np.asarray(self.differences(levels, better, worse) * self.weights.T[:, :, None])

    def gain(
        self,
        differences: Float[np.ndarray, "c s a"],
        weights: Float[np.ndarray, "s w"] | None = None,
        rows: Int[np.ndarray, " r"] | None = None,
    ) -> Float[np.ndarray, "r a"]:
        """Return how much better one experiment is than another, by all parts together, shape (r, a).

        `weights` are those of these draws, if they are known; `rows` are draws, shape (r,), None for all.
        """
        used, weights = self.used, self.weights if weights is None else weights
        weights, differences = weights[:, :used], differences[:used]
        if rows is not None:
            weights, differences = weights[rows], differences.take(rows, axis=1)
        # In one pass, since a long study has 20 MB of them, and in the order of the parts.
        return np.asarray(np.einsum("sc,csa->sa", weights, differences))

    def log_answers(
        self,
        gain: Float[np.ndarray, "r a"],
        tie: Bool[np.ndarray, " a"],
        rows: Int[np.ndarray, " r"] | slice = slice(None),
    ) -> Float[np.ndarray, "r a"]:
        """Return the logarithm of each answer's probability in each draw, shape (r, a): Screening, rule 5.

        Args:
            gain: How much better the preferred experiment is, or one of a tie, see `gain`.
            tie: Whether the answer is that they are alike, shape (a,).
            rows: Draws that `gain` is of, shape (r,); all by default.
        """
        error = self.errors[rows, None]
        # Beyond 4, a difference is noticed for sure, to the last bit: most answers of a long study.
        close = ~(gain > 4.0)
        close[:, tie] = True
        few = 4 * np.count_nonzero(close) <= close.size  # to pick more takes longer than to compute all
        at = np.nonzero(close) if few else ()
        own, ties, wrong = (
            (gain[at], tie[at[1]], error[at[0], 0]) if few else (gain, (slice(None), tie), error)
        )
        explained, even = notice_chance(own), own[ties]
        explained[ties] = 1.0 - notice_chance(even) - notice_chance(-even)
        # A mistake is any of the three answers, so that no single one can rule out a draw.
        explained *= 1.0 - wrong
        explained += wrong / 3.0
        np.log(explained, out=explained)
        if not few:
            return explained
        found = np.broadcast_to(np.log(1.0 - error + error / 3.0), gain.shape).copy()
        found[at] = explained
        return found

    @property
    def parts(self) -> Iterable[int]:
        """Return what a cost is the sum of, by number: each KPI, and each stated limit."""
        stated = np.isfinite(self.limits).any(axis=0)
        return (*range(len(stated)), *(len(stated) + np.flatnonzero(stated)).tolist())

    @property
    def used(self) -> int:
        """Return the number of parts up to the last one of `parts`."""
        return max(self.parts, default=-1) + 1

    def some(self, count: int) -> "Utilities":
        """Return every n-th draw, `count` of them if that divides their number."""
        return self.take(np.arange(0, len(self), len(self) // count))

    def take(self, rows: Int[np.ndarray, " r"]) -> "Utilities":
        """Return the draws in `rows`, shape (r,)."""
        return Utilities(*[getattr(self, f.name)[rows] for f in fields(self)])

    def where(self, mask: Bool[np.ndarray, " s"], other: "Utilities") -> "Utilities":
        """Return these draws, and those of `other` where `mask` holds, shape (s,)."""
        rows = np.arange(len(self)) + len(self) * mask
        return Utilities(
            *[np.concatenate([getattr(self, f.name), getattr(other, f.name)])[rows] for f in fields(self)]
        )

    def mutate(self, other: "Utilities", rng: np.random.Generator) -> "Utilities":
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
        changed = {
            name: np.where(mask, getattr(other, name), getattr(self, name)) for name, mask in masks.items()
        }
        return replace(self, normals=np.where(weight, step, self.normals), **changed)


def _subtract(
    levels: Float[np.ndarray, "*parts p"],
    better: Int[np.ndarray, " a"],
    worse: Int[np.ndarray, " a"],
    counted: Bool[np.ndarray, "*parts"],
) -> Float[np.ndarray, "*parts a"]:
    """Return differences of levels, shape (..., a); see `Utilities.differences`."""
    found = levels.take(worse, axis=-1)
    found -= levels.take(better, axis=-1)
    # Only whether a difference is noticed: a large one must not outweigh an earlier KPI.
    found[counted] = np.clip(np.trunc(found[counted]), -1, 1)
    return np.asarray(found)


def notice_chance(gain: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return how probably a difference of costs is noticed."""
    # The threshold scatters with a standard deviation of a third of a just noticeable difference.
    scaled = np.asarray(gain - 1.0)
    scaled *= 3.0
    return np.asarray(ndtr(scaled, out=scaled))


# --- Learn from answers: draw costs by how well they explain them, and ask whether they do.
#
# A person may judge by something that no KPI measures. Then a model over θ explains the answers better.

DRAWS = 1024
"""Number of draws that stand for what is known."""
AFTER = 10
"""Number of answers before KPIs can be left; fewer say too little."""
_AT_ONCE = 256  # number of draws that are worked out at a time: levels of a long study stay in the cache


@dataclass(frozen=True, eq=False, slots=True)
class Lessons:
    """Answers as arrays, about experiments given by their log distances.

    Args:
        logs: Log distances of the shown experiments, shape (p, k).
        better: Row of one experiment of each answer, the preferred one unless it is a tie, (a,).
        worse: Row of the other one, shape (a,).
        tie: Whether they are alike, shape (a,).
        strength: Weight c_h of each answer as in eq. QP-pref, shape (a,).
    """

    logs: Float[np.ndarray, "p k"]
    better: Int[np.ndarray, " a"]
    worse: Int[np.ndarray, " a"]
    tie: Bool[np.ndarray, " a"]
    strength: Float[np.ndarray, " a"]

    @classmethod
    def of(cls, bank: Bank, scale: Scale, history: History) -> "Lessons":
        """Return the answers of `history`.

        An unsafe experiment is worse than all others that a person looked at.
        """
        rows = bank.rows([sample.theta for sample in history.samples[: history.answered]])
        given: list[tuple[int, int | None, Preference | None, float]] = [
            (c.challenger, c.incumbent, c.answer.preference, c.answer.strength) for c in history.lessons
        ]
        unsafe = history.unsafe
        seen = {i for c in history.counting if c.incumbent is not None for i in (c.challenger, c.incumbent)}
        given += [(i, j, Preference.CHALLENGER, 1.0) for j in sorted(unsafe) for i in sorted(seen - unsafe)]
        turned = [(b, a) if p is Preference.INCUMBENT else (a, b) for a, b, p, _ in given]
        pairs = np.array(turned, dtype=np.int64).reshape(-1, 2)
        return cls(
            scale(bank, rows),
            pairs[:, 0],
            pairs[:, 1],
            np.array([p is Preference.TIE for _, _, p, _ in given], dtype=np.bool_),
            np.array([strength for *_, strength in given], dtype=float),
        )

    def __len__(self) -> int:
        return len(self.tie)

    def join(self, others: "Lessons") -> "Lessons":
        """Return these answers, then `others`, which are about other experiments."""
        if not len(others):
            return self
        return Lessons(
            np.vstack([self.logs, others.logs]),
            np.append(self.better, others.better + len(self.logs)),
            np.append(self.worse, others.worse + len(self.logs)),
            np.append(self.tie, others.tie),
            np.append(self.strength, others.strength),
        )

    def shared(self, others: "Lessons") -> int:
        """Return how many answers are those of `others`, from the first one on."""
        count = min(len(self), len(others))
        same = self.tie[:count] == others.tie[:count]
        for ours, theirs in ((self.better, others.better), (self.worse, others.worse)):
            same &= (self.logs[ours[:count]] == others.logs[theirs[:count]]).all(axis=1)
        return int(np.argmin(np.append(same, False)))

    def first(self, count: int) -> "Lessons":
        """Return the first `count` answers, about the same experiments."""
        return Lessons(
            self.logs, self.better[:count], self.worse[:count], self.tie[:count], self.strength[:count]
        )

    def take(self, answers: Int[np.ndarray, " b"]) -> "Lessons":
        """Return some answers, about the experiments that they name."""
        pair = np.append(self.better[answers], self.worse[answers])
        shown, rows = np.unique(pair, return_inverse=True)
        better, worse = np.split(rows, 2)
        return Lessons(self.logs[shown], better, worse, self.tie[answers], self.strength[answers])

    def differences(self, utilities: Utilities) -> Float[np.ndarray, "c s a"]:
        """Return how much better one experiment of each answer is, by the parts that are used.

        See `Utilities.differences`.
        """
        found, counted = np.zeros((utilities.used, len(utilities), len(self))), utilities.counted
        every = np.split(np.arange(len(utilities)), range(_AT_ONCE, len(utilities), _AT_ONCE))
        for part, draws in product(utilities.parts, every):
            level = utilities.level(self.logs, part, draws)
            found[part, draws] = _subtract(level, self.better, self.worse, counted[part, draws])
        return found


@dataclass(frozen=True, eq=False, slots=True)
class Posterior:
    """Draws given answers, and what each of them says of each answer.

    Args:
        utilities: s draws.
        lessons: The answers.
        logs: Logarithm of the probability of each answer, see `Utilities.log_answers`, shape (s, a).
    """

    utilities: Utilities
    lessons: Lessons
    logs: Float[np.ndarray, "s a"]

    @classmethod
    def of(cls, utilities: Utilities, lessons: Lessons) -> "Posterior":
        """Return what draws, which are given the answers already, say of them."""
        gain = utilities.gain(lessons.differences(utilities))
        return cls(utilities, lessons, utilities.log_answers(gain, lessons.tie))

    def update(
        self, new: Lessons, scale: Scale, rng: np.random.Generator, mistakes: Mistakes = REAL
    ) -> "Posterior":
        """Return draws given the answers `new` instead. Those that both begin with are not worked out again.

        Screening, rule 6.
        Source: N. Chopin, "A sequential particle filter method for static models" (2002): draws are
        repeated by how well they explain the new answers, then moved by Metropolis steps.
        Deviation: proposals draw from the distribution before any answer, so that the likelihood alone
        decides.
        """
        before, kept = self.utilities, new.shared(self.lessons)
        fresh = new.take(np.arange(kept, len(new)))
        added = before.log_answers(before.gain(fresh.differences(before)), fresh.tie)
        logs = np.hstack([self.logs[:, :kept], added])
        # Only the ratio: the draws already follow the old answers, which may change, too, when one is
        # retracted.
        gained = logs @ new.strength - self.logs @ self.lessons.strength
        shares = np.cumsum(np.exp(gained - gained.max()))
        # Systematic: one random number for all, so that a draw is repeated as often as it should be, to
        # within one.
        places = (rng.random() + np.arange(len(before))) / len(before) * shares[-1]
        rows = np.minimum(np.searchsorted(shares, places), len(before) - 1)
        rows = rng.permutation(rows)
        return _move(Posterior(before.take(rows), new, logs.take(rows, axis=0)), scale, rng, mistakes)


def learn(before: Utilities, lessons: Lessons, scale: Scale, rng: np.random.Generator) -> Utilities:
    """Return draws given all answers of `lessons`, one after the other."""
    given = Posterior.of(before, lessons.first(0))
    for count in range(len(lessons)):
        given = given.update(lessons.first(count + 1), scale, rng)
    return given.utilities


_TELLING = 64
"""Number of answers that are looked at first: those that are explained worst refuse nearly all steps that all
answers together refuse."""
_MISSED = 32  # number of such steps that these let pass from which on others are looked at, too


class _Told(NamedTuple):
    """Answers, and how much better one experiment of each is by each draw, which steps change in place.

    `apart` is what `Utilities.differences` returns, `others` the strength of the answers left out.
    """

    lessons: Lessons
    apart: Float[np.ndarray, "c s a"]
    others: float = 0.0

    def worst(self, logs: Float[np.ndarray, "s a"]) -> "_Told":
        """Return the answers that are explained worst, by what `Utilities.log_answers` returned."""
        rows = np.argsort(logs.sum(axis=0) * self.lessons.strength, kind="stable")[:_TELLING]
        few = self.lessons.take(rows)
        others = float(self.lessons.strength.sum() - few.strength.sum())
        return _Told(few, self.apart.take(rows, axis=2), others)

    def change(
        self,
        tried: Utilities,
        weights: Float[np.ndarray, "s w"],
        rows: Int[np.ndarray, " r"],
        part: Int[np.ndarray, " q"],
        draw: Int[np.ndarray, " q"],
    ) -> tuple[Float[np.ndarray, "r a"], Float[np.ndarray, "q a"]]:
        """Return `Utilities.log_answers` of draws `rows`, and what was changed, shapes (r, a) and (q, a).

        In `apart`, parts `part` of the draws `draw` change. `weights` are those of `tried`.
        """
        (given, apart, _), counted = self, tried.counted[part, draw]
        changed = _subtract(tried.level(given.logs, part, draw), given.better, given.worse, counted)
        before, apart[part, draw] = apart[part, draw], changed
        # In parts of 200 kB, which stay in the cache: of a long study, those of all rows are 12 MB.
        found, size = np.empty((len(rows), len(given))), 1 + 2**15 // max(len(given), 1)
        for start in range(0, len(rows), size):
            some = rows[start : start + size]
            gain = tried.gain(apart, weights, some)
            found[start : start + size] = tried.log_answers(gain, given.tie, some)
        return found, before


def _move(given: Posterior, scale: Scale, rng: np.random.Generator, mistakes: Mistakes) -> Posterior:
    """Return the draws after Metropolis steps. Only what a step changes is computed again.

    Of a long study, a step that a few answers refuse meets no other.
    """
    utilities, logs = given.utilities, given.logs
    told = _Told(given.lessons, given.lessons.differences(utilities))
    count, k = utilities.normals.shape
    stages = [told.worst(logs), told] if len(told.lessons) > 2 * _TELLING else [told]
    likely, weights = logs @ told.lessons.strength, utilities.weights
    for _ in range(24):  # 40 brought nothing more: docs/research/screening.md
        # Orders stay orders here: the share of both kinds changes by repetition alone.
        new = Utilities.draw(scale, count, rng, utilities.ordered > 0, mistakes)
        tried = utilities.mutate(new, rng)
        # A new shape always has a new just noticeable difference, so this finds the KPIs whose levels change.
        draw, kpi = np.nonzero(tried.steps != utilities.steps)
        stated = np.isfinite(tried.limits[draw, kpi])
        draw, part = np.append(draw, draw[stated]), np.append(kpi, kpi[stated] + k)
        # Many steps change nothing that counts, such as the shape of a KPI that an order leaves out.
        after = tried.weights
        counts = (after != weights).any(axis=1) | (tried.errors != utilities.errors)
        counts[draw[after[draw, part] != 0.0]] = True
        # Proposals follow the prior, and weights a step that keeps it, so prior and proposal cancel.
        least, found = np.log(rng.random(count)) + likely, []
        left = counts | (likely > least)
        for stage in stages:
            part, draw, rows = part[left[draw]], draw[left[draw]], np.flatnonzero(left & counts)
            each, before = stage.change(tried, after, rows, part, draw)
            most = each @ stage.lessons.strength
            # None of the others is more probable than if explained for sure. The last term covers rounding.
            if stage.others:
                most += stage.others * np.log1p(-tried.errors[rows] * 2.0 / 3.0) + 1e-6
            found.append((stage.apart, part, draw, before))
            left[rows] = most > least[rows]
        kept = left[rows]
        likely[rows[kept]], logs[rows[kept]], weights[left] = most[kept], each[kept], after[left]
        for apart, part, draw, before in found:
            refused = ~left[draw]
            apart[part[refused], draw[refused]] = before[refused]
        # What few let pass and all refuse tells which others to look at next: once, since copies take time.
        if len(stages) == 2 and np.count_nonzero(~kept) > _MISSED:
            stages.insert(1, told.worst(each[~kept] - logs[rows[~kept]]))
        utilities = utilities.where(left, tried)
    return replace(given, utilities=utilities)


def explains(history: History, given: Posterior) -> bool:
    """Return whether KPIs predict the answers about as well as θ does, or too few are known.

    Source: A. E. Gelfand, D. K. Dey, H. Chang, "Model determination using predictive
    distributions" (1992).

    Args:
        history: Samples and answers.
        given: Draws of what the person wants, given these answers first.
    """
    lessons = history.lessons
    if len(lessons) < AFTER or not any(c.answer.preference for c in lessons):
        return True
    # Of a long study, the process predicts the latest answers only: KPIs must not pay for all others.
    preferences = Preferences.of(history)
    counting, _ = latest(preferences)
    # Each answer predicted from the others: the harmonic mean over draws given all answers.
    means = logsumexp(-given.logs[:, counting], axis=0)
    by_kpis = float(np.sum(np.log(len(given.logs)) - means))
    # By 2 nats: a smaller difference may be chance. The process takes 3 % of the answers for mistakes.
    return bool(predicted(preferences, 0.03) <= by_kpis + 2.0)


# --- What KPIs may be on the plant, given what was measured, and a simulation if there is one.
#
# Each KPI is a Gaussian process over θ, on the scale on which KPIs are judged. A simulation of another
# plant than the one that runs is a rough model of it, a twin: then the process is the difference between
# both. How far the twin is trusted follows from the measured values: with some probability, which they
# decide, a KPI is predicted without the twin.

_TRUST = 0.5  # probability, before anything is measured, that a KPI follows the twin's
_OFFSET = {True: 0.5, False: 2.0}
"""Variance of what is the same for all θ, over that of the process: with the twin and without."""
_NUGGET = 1e-3  # variance of what θ does not explain, such as noise, over that of the process
_FEATURES = 200  # number of random cosines that a draw of a process is made of
_INFINITE = 0.5  # logarithm of how much worse than all finite values an infinite one counts


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """KPIs that were measured on the plant.

    Args:
        rows: Rows of the bank whose θ have run, shape (r,).
        kpis: Their KPIs.
        reading: How people read them.
    """

    rows: Int[np.ndarray, " r"]
    kpis: KPIValues
    reading: Reading

    @classmethod
    def of(cls, bank: Bank, history: History, reading: Reading) -> "Measured":
        """Return the KPIs that the answers of `history` tell; none if all read as simulated."""
        names, values = history.kpis
        known = ~np.isnan(values).all(axis=1)
        known[[*history.cut_short]] = False  # their KPIs are bounds
        rows = bank.rows([history.samples[index].theta for index in np.flatnonzero(known)])
        found = cls(rows, KPIValues(names, values[known]), reading)
        # What was stored and read again may differ in the last digit.
        same = np.isclose(found.on(bank).kpis, bank.kpis, rtol=1e-9, atol=0.0)
        return cls(rows[:0], KPIValues((), np.zeros((0, 0))), reading) if same.all() else found

    def __len__(self) -> int:
        return len(self.rows)

    def on(self, bank: Bank) -> Bank:
        """Return the bank with what was measured in place of what was simulated."""
        if not len(self):
            return bank
        kpis = bank.kpis.copy()
        for name, values in zip(self.kpis.names, self.kpis.values.T, strict=True):
            if name in bank.names:
                column = bank.names.index(name)
                kpis[self.rows, column] = np.where(np.isnan(values), kpis[self.rows, column], values)
        kpis[self.rows] = self.reading.table(bank.names, kpis[self.rows])
        return replace(bank, kpis=kpis)


def draw_on_plant(
    z: Float[np.ndarray, "m n"],
    simulated: Float[np.ndarray, "m k"] | None,
    rows: Int[np.ndarray, " r"],
    measured: Float[np.ndarray, "r k"],
    draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "d m k"]:
    """Return draws of what each KPI may be on the plant, shape (d, m, k): Screening, rule 11.

    Source: M. C. Kennedy, A. O'Hagan, "Predicting the output from a complex computer code when fast
    approximations are available" (2000): the plant is the simulation plus a Gaussian process.
    Deviation: the simulation can be left out. Scales are averaged over analytically.

    Args:
        z: Points of the cube, shape (m, n).
        simulated: Log distances of the simulated KPIs, infinite where a KPI is, shape (m, k); None
            without a simulation.
        rows: Rows that were measured, shape (r,).
        measured: Their measured log distances, shape (r, k).
        draws: Number d of draws.
        rng: Generator of the draws.
    """
    found = np.empty((draws, len(z), measured.shape[1]))
    trusts = (False,) if simulated is None else (True, False)
    # Lengths in units of √n: from a fraction of the cube to hardly any change across it.
    beliefs = [_Belief.of(z, rows, length, twin) for length in (0.3, 0.6, 1.2) for twin in trusts]
    for kpi, real in enumerate(measured.T):
        twin = real if simulated is None else simulated[:, kpi]
        known = np.concatenate([twin, real])
        known = known[np.isfinite(known)]
        cap = (known.max() if len(known) else 0.0) + _INFINITE
        values = _draw_kpi(beliefs, np.minimum(twin, cap), np.minimum(real, cap), rows, draws, rng)
        # What was measured is exact, whatever its noise: a person judged these values.
        values[:, rows] = real
        # Infinite KPIs entered as slightly worse than all others; drawn values nearer to that are infinite
        # again.
        found[:, :, kpi] = np.where(values > cap - _INFINITE / 2, np.inf, values)
    return found


def _draw_kpi(
    beliefs: Sequence["_Belief"],
    twin: Float[np.ndarray, " t"],
    real: Float[np.ndarray, " r"],
    rows: Int[np.ndarray, " r"],
    draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "d m"]:
    """Return draws of one KPI, each by one of the beliefs, as likely as the values make it.

    `twin` are all simulated values or, without a simulation, the measured ones.
    """
    spread, count = float(twin.std()) + 1e-9, len(beliefs[0].outer)
    bases = [twin if belief.twin else np.full(count, twin.mean()) for belief in beliefs]
    fits = [belief.fit(real - base[rows], spread) for belief, base in zip(beliefs, bases, strict=True)]
    # Averaged over beliefs instead of choosing the likeliest: after two or three runs none is sure.
    chosen = rng.choice(len(beliefs), draws, p=softmax([fit.evidence for fit in fits]))
    found = np.empty((draws, count))
    for k in np.unique(chosen):
        mine = np.flatnonzero(chosen == k)
        found[mine] = bases[k] + beliefs[k].paths(fits[k], len(mine), rng)
    return found


class _Fit(NamedTuple):
    """A process given values: log evidence, K⁻¹ times the values, and its variance."""

    evidence: float
    alpha: Float[np.ndarray, " r"]
    variance: float


@dataclass(frozen=True, eq=False, slots=True)
class _Belief:
    """A Gaussian process for what is added to the twin, if it is trusted, or for all of a KPI.

    `rows` are the points with values, `inner` is their covariance over the variance of the process,
    `outer` that of all points with them. Normal combinations of `features` are draws of the process.
    """

    twin: bool
    rows: Int[np.ndarray, " r"]
    inner: Float[np.ndarray, "r r"]
    outer: Float[np.ndarray, "m r"]
    features: Float[np.ndarray, "m f"]

    @classmethod
    def of(
        cls, z: Float[np.ndarray, "m n"], rows: Int[np.ndarray, " r"], share: float, twin: bool
    ) -> "_Belief":
        """Return the process with this length, in units of √n."""
        knobs = z.shape[1]
        length = share * np.sqrt(knobs)
        outer = matern(squares(z, z[rows]) / length**2)[0] + _OFFSET[twin]
        # Always the same cosines: then draws differ by their weights alone, for all lengths and KPIs.
        rng = np.random.default_rng(_FEATURES)
        # The spectrum of the kernel is Student's t distribution with five degrees of freedom.
        tails = np.sqrt(rng.chisquare(5.0, (_FEATURES, 1)) / 5.0)
        waves = rng.standard_normal((_FEATURES, knobs)) / tails / length
        phases = rng.uniform(0.0, 2.0 * np.pi, _FEATURES)
        cosines = np.sqrt(2.0 / _FEATURES) * np.cos(z @ waves.T + phases)
        constant = np.full((len(z), 1), np.sqrt(_OFFSET[twin]))
        return cls(
            twin, rows, outer[rows] + _NUGGET * np.eye(len(rows)), outer, np.hstack([cosines, constant])
        )

    def fit(self, values: Float[np.ndarray, " r"], spread: float) -> _Fit:
        """Fit to what was measured; its variance has an inverse gamma distribution before.

        Args:
            values: Measured values less the mean of the process, shape (r,).
            spread: Standard deviation of the KPI over random θ.
        """
        # A twin that is trusted is off by 0.3 of what the KPI varies over random θ, before anything is known.
        prior = (spread * (0.3 if self.twin else 1.0)) ** 2
        alpha = np.linalg.solve(self.inner, values)
        # Inverse gamma with shape 1 and scale `prior`: the variance can be integrated out in closed form.
        half, shape = float(values @ alpha) / 2, 1.0 + len(values) / 2
        factor = np.linalg.cholesky(self.inner)
        evidence = np.log(_TRUST if self.twin else 1.0 - _TRUST) - shape * np.log1p(half / prior)
        evidence -= len(values) / 2 * np.log(prior) + np.log(np.diag(factor)).sum()
        return _Fit(float(evidence), alpha, (prior + half) / shape)

    def paths(self, fit: _Fit, count: int, rng: np.random.Generator) -> Float[np.ndarray, "c m"]:
        """Return draws of the process at all points, given the values, shape (c, m).

        Source: J. T. Wilson et al., "Efficiently sampling functions from Gaussian process
        posteriors" (2020): a draw before the values, plus what they change.
        """
        drawn = self.features @ rng.standard_normal((self.features.shape[1], count))
        noise = np.sqrt(_NUGGET) * rng.standard_normal((len(self.rows), count))
        changed = self.outer @ np.linalg.solve(self.inner, drawn[self.rows] + noise)
        paths = np.sqrt(fit.variance) * (drawn - changed) + (self.outer @ fit.alpha)[:, None]
        return np.asarray(paths.T)


# --- What a θ is worth, and what takes the place of the best one.


def worth(costs: Float[np.ndarray, "s m"]) -> Float[np.ndarray, "s m"]:
    """Return the negative logarithm of the number of θ noticeably better than each, plus 4, (s, m).

    Halving the number of better θ is worth the same everywhere, from a poor θ to the very best.
    """
    better = np.empty(costs.shape, dtype=np.int64)
    for found, row in zip(better, costs, strict=True):
        order = np.argsort(row)  # what increases is searched for in a third of the time
        found[order] = np.searchsorted(row[order], row[order] - 1.0)
    # 3 more: which of the very first ranks a θ has is chance, docs/research/screening.md.
    return np.asarray(-np.log(better + 3.0 + 1.0))


def expected_best(costs: Float[np.ndarray, "s m"], best: int | None) -> Float[np.ndarray, " m"]:
    """Return the expected worth of the better one of each θ and the best so far, shape (m,).

    The answer decides which of both is kept, so the θ with the largest value is the one to show.
    Where the person would not notice that it is better, it is kept by chance, and counts nothing.

    Source: Z. J. Lin et al., "Preference exploration for efficient Bayesian optimization with
    multiple outcomes" (2022): the expected utility of the best option.
    Deviation: the utility is the logarithm of the rank, since a draw of the cost has no unit.

    Args:
        costs: Cost of each θ in each draw, shape (s, m).
        best: Row of the best one so far; None if nothing was shown.
    """
    found = worth(costs)
    if best is not None:
        found = np.where(costs < costs[:, [best]] - 1.0, found, found[:, [best]])
    return np.asarray(found.mean(axis=0))


# Probability of being noticeably better than the best by the answers, above which an experiment takes its
# place. With 0.5, people who never err lose (1,292 instead of 1,478 after ten answers), and with 0.9 those
# who are wrong every fifth time (423 instead of 614 after twenty): docs/research/screening.md.
_DOUBT = 0.75
# From this probability on that the person hardly follows the KPIs, nothing takes the place of what won: it is
# the one before any answer. People whose taste KPIs hardly explain end better so (docs/research/people.md).
_LOOSE = REAL[-1][1]


def overtaking(better: Float[np.ndarray, " n"], loose: float, history: History) -> Float[np.ndarray, " n"]:
    """Return how probably each sample is noticeably better than the best by the answers, (n,).

    It is 0 where the probability is 0.75 or less, for runs that were unsafe or cut short, and for all
    samples if `loose` is 0.25 or more, as before any answer.

    Args:
        better: That probability by the draws, shape (n,).
        loose: Probability that the person hardly follows the KPIs, see `Utilities.loose`.
        history: Samples and answers.
    """
    found = np.where((better > _DOUBT) & (loose < _LOOSE), better, 0.0)
    # An unsafe run never leads, and the KPIs of one that was cut short are bounds, not values.
    found[[*history.unsafe, *history.cut_short]] = 0.0
    return found
