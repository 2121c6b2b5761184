"""What a person may want from KPIs, how probable it makes an answer, and which θ is worth showing."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit, ndtr

from prefcal_env.preferences.history import History, KPIValues


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

DRAWS = 1024
"""Number of draws that stand for what is known."""


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
        """Return `count` draws before any answer is known.

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
        # d^p / (s^p + d^p) in logarithms, the share of the weight that is lost at the distance d.
        found = x - scales
        found *= exponents
        expit(found, out=found)
        x = np.broadcast_to(x, found.shape)
        above = np.exp(np.maximum(x[order], scales[order])) - np.exp(scales[order])
        # Below `scales` all values are alike; above, distances count in just noticeable differences.
        found[order] = np.minimum(above / steps[order], 1e9)  # infinity times a weight of 0 is NaN
        found[beyond] = 0.0
        beyond = beyond & np.isfinite(limits[:, 0])
        # A value at its limit keeps it, also where the logarithm and back added a last digit.
        excess = np.exp(x[beyond]) * (1 - 1e-9) - limits[beyond]
        found[beyond] = np.clip(np.ceil(excess / steps[beyond]), 0, 255)
        return np.asarray(found)

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
            found[part] = subtract(levels[part], better, worse, counted[part])
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
        weights = (self.weights if weights is None else weights)[:, : self.used]
        differences = differences[: self.used]
        if rows is None:  # in one pass, since a long study has 20 MB of them, and in the order of the parts
            return np.asarray(np.einsum("sc,csa->sa", weights, differences))
        found = np.empty((len(rows), differences.shape[2]))
        for row, own in zip(rows.tolist(), found, strict=True):
            np.einsum("c,ca->a", weights[row], differences[:, row], out=own)
        return found

    def log_answers(
        self, differences: Float[np.ndarray, "c s a"], tie: Bool[np.ndarray, " a"]
    ) -> Float[np.ndarray, "s a"]:
        """Return the logarithm of the probability of each answer by each draw, shape (s, a).

        Args:
            differences: How much better the preferred experiment is, or one of a tie, see `differences`.
            tie: Whether the answer is that they are alike, shape (a,).
        """
        return log_answers(self.gain(differences), tie, self.errors[:, None])

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


def subtract(
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


def log_answers(
    gain: Float[np.ndarray, "s a"], tie: Bool[np.ndarray, " a"], error: Float[np.ndarray, "s 1"]
) -> Float[np.ndarray, "s a"]:
    """Return `Utilities.log_answers` by the gain in each answer and the rates of mistakes."""
    # Beyond 4, a difference is noticed for sure, to the last bit: most answers of a long study.
    close = ~(gain > 4.0)
    close[:, tie] = True
    few = 4 * np.count_nonzero(close) <= close.size  # to pick more takes longer than to compute all
    at = np.nonzero(close) if few else ()
    own, ties, wrong = (gain[at], tie[at[1]], error[at[0], 0]) if few else (gain, (slice(None), tie), error)
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


def notice_chance(gain: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return how probably a difference of costs is noticed."""
    # The threshold scatters with a standard deviation of a third of a just noticeable difference.
    scaled = np.asarray(gain - 1.0)
    scaled *= 3.0
    return np.asarray(ndtr(scaled, out=scaled))


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
