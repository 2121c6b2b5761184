"""Learn the score behind a person's answers as a weighted sum of KPIs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import fsum

import numpy as np
from jaxtyping import Float

from prefcal_env.preferences.history import History

from .lessons import Preferences, fill_kpis, normalize
from .surrogate import Constraints, Learning, fit

CEILING = 2.0  # see `normalize`: an interrupted run must not flatten the other differences


@dataclass(frozen=True, slots=True)
class Outcomes:
    """The p KPIs of N samples."""

    # KPIs, lower is better: 0 for the best sample and 1 for the worst, shape (N, p)
    columns: Float[np.ndarray, "N p"]
    names: tuple[str, ...]  # names of the p KPIs
    ranges: tuple[tuple[float, float], ...]  # values of each KPI that count as 0 and as 1, in its unit

    @classmethod
    def of(cls, history: History) -> "Outcomes":
        """Return the KPIs that came with the answers in `history`.

        For missing values see `fill_kpis`; an infinite value counts as the worst. A KPI with one
        value only is left out because nothing can be learned from it.
        """
        columns: dict[str, Float[np.ndarray, " N"]] = {}
        ranges = []
        known = fill_kpis(history)
        for name, values in zip(known.names, known.values.T, strict=True):
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
    shares[finite] = normalize(values[finite], CEILING)
    best = float(values[finite].min())
    if not shares[finite].any():
        return shares, (best, np.inf)  # only infinite values are worse
    # Shares are linear in the values up to the cap, or up to the largest value.
    inner = int(np.argmax(np.where(shares[finite] < 1.0, shares[finite], 0.0)))
    share, value = float(shares[finite][inner]), float(values[finite][inner])
    worst = best + (value - best) / share if share > 0 else float(values[finite].max())
    return shares, (best, worst)


_SOFT = Learning(sigma=1.0, lam=0.1)
"""Soft margins, since some answers contradict any sum of KPIs: a slack costs ten margins."""
_ALIKE = 1e-6  # smaller distances in KPIs count as this

_FOLDS = 3
_SURE = 1.645  # standard deviations: one-sided 5 %
_COUNTS = 0.01  # KPIs with a smaller share of the weights are left out


@dataclass(frozen=True, slots=True)
class CostTerm:
    """One KPI of a learned index, which adds 0 at `best` and `weight` at `worst` and beyond."""

    weight: float  # share of all weights, above 0
    best: float  # lowest value of the study, in the unit of the KPI
    worst: float  # value that counts in full; larger values count the same


@dataclass(frozen=True)
class LearnedCost:
    """A learned index, a sum of terms: lower is better. Call it with KPIs by name."""

    terms: Mapping[str, CostTerm]  # KPI name to its term, largest weight first; the weights sum to 1
    predicted: int  # number of answers predicted correctly when left out of the training
    answers: int  # number of strict answers

    def __call__(self, kpis: Mapping[str, float]) -> float:
        """Return the index of an experiment; an unknown or infinite KPI counts in full."""
        # fsum gives the same digits as the exported module in every Python version.
        return fsum(t.weight * _share(kpis.get(name), t) for name, t in self.terms.items())

    @property
    def explains(self) -> bool:
        """Return whether it predicts clearly more than half; chance does once in 20 studies."""
        beyond = self.predicted - self.answers / 2
        return bool(beyond > _SURE * np.sqrt(self.answers) / 2)

    @property
    def weights(self) -> Mapping[str, float]:
        """Return KPI name to share of all weights, largest first."""
        return {name: term.weight for name, term in self.terms.items()}

    @classmethod
    def of(cls, history: History, seed: int) -> "LearnedCost | None":
        """Learn the index from the answers in `history`; None without KPIs or strict answers.

        Source: none; eq. QP-pref with KPIs instead of φ, weights 0 or more, and soft margins,
        explained in `_weights`.
        """
        outcomes, preferences = Outcomes.of(history), Preferences.of(history)
        if not len(outcomes) or not preferences.b.any():
            return None
        weights = _weights(preferences, outcomes.columns)
        if weights.sum() <= 0:
            return None
        weights = np.where(weights < _COUNTS * weights.sum(), 0.0, weights)
        shares = weights / weights.sum()
        order = [int(k) for k in np.argsort(-shares, kind="stable") if shares[k] > 0]
        predicted = _predicted(preferences, outcomes.columns, seed)
        terms = {outcomes.names[k]: CostTerm(float(shares[k]), *outcomes.ranges[k]) for k in order}
        return cls(terms, predicted, int(np.count_nonzero(preferences.b)))

    def to_python(self) -> str:
        """Return the source of a self-contained Python module with a function `index(kpis)`."""
        lines = [
            f"    {name!r}: ({term.weight!r}, {term.best!r}, {term.worst!r}),"
            for name, term in self.terms.items()
        ]
        return _MODULE.format(terms="\n".join(lines), predicted=self.predicted, answers=self.answers)


_MODULE = '''"""An index learned from comparisons of experiments; lower is better.

It predicted {predicted} of {answers} answers that it had not learned from.
"""

from math import fsum, inf

TERMS = {{
    # KPI: (weight, best value of the study, value that counts in full)
{terms}
}}


def index(kpis):
    """Return the index of an experiment from its KPIs by name; an unknown KPI counts in full."""
    terms = []
    for name, (weight, best, worst) in TERMS.items():
        share = (kpis.get(name, worst) - best) / (worst - best)
        better = share < 1.0 or kpis.get(name, worst) < best
        terms.append(weight * (max(-1.0, share) if better else 1.0))
    return fsum(terms)
'''


def _share(value: float | None, term: CostTerm) -> float:
    if value is None:
        return 1.0
    share = (value - term.best) / (term.worst - term.best)
    # NaN (unknown, or never) counts in full, unless it is -inf against an infinite worst.
    better = share < 1.0 or value < term.best
    return max(-1.0, share) if better else 1.0


def _weights(preferences: Preferences, columns: Float[np.ndarray, "N p"]) -> Float[np.ndarray, " p"]:
    """Return the weights w, 0 or more, shape (p,).

    The margin of a comparison is the distance of its two experiments in KPIs. With one margin for
    all, experiments that hardly differ, which are most common late in a study, would weigh most.
    That found the two KPIs behind the answers in 6 of 10 toy studies, this one in 8; on the CSTR
    its correlation with the true index on other experiments was 0.41, this one's 0.60.
    """
    constraints = Constraints.of(preferences, columns, np.ones(len(preferences))).nonnegative()
    apart = np.linalg.norm(columns[preferences.first] - columns[preferences.second], axis=1)
    length = np.append(np.maximum(apart, _ALIKE), 1.0)[constraints.owner]  # the last: owner -1
    unit = replace(constraints, rows=constraints.rows / length[:, None])
    return np.asarray(np.maximum(fit(unit, _SOFT), 0.0))


def _predicted(preferences: Preferences, columns: Float[np.ndarray, "N p"], seed: int) -> int:
    """Return the number of strict answers that weights learned from others predict (3-fold)."""
    strict = preferences.subset(np.flatnonzero(preferences.b))
    share = np.random.default_rng([seed, len(strict), 2]).permutation(len(strict)) % _FOLDS
    right = 0
    for fold in range(_FOLDS):
        rest, left = strict.subset(np.flatnonzero(share != fold)), np.flatnonzero(share == fold)
        if not len(rest):
            continue
        values = columns @ _weights(rest, columns)
        gap = values[strict.first[left]] - values[strict.second[left]]
        right += int(np.count_nonzero(strict.b[left] * gap > 0))
    return right
