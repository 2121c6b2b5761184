"""The score that a person could not write down: a weighted sum of KPIs, from his answers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import fsum

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.history import History, Preferences
from prefcal_env.qp import Backend

from .kpi_model import Outcomes
from .preference_qp import Constraints, Learning, fit

_SOFT = Learning(sigma=1.0, lam=0.1)
"""Of a few dozen answers some contradict any sum of KPIs: a slack costs ten margins, no more."""
_ALIKE = 1e-6  # experiments whose KPIs differ less count as this far apart

_FOLDS = 3
_SURE = 1.645  # standard deviations: one-sided 5 %
_COUNTS = 0.01  # a smaller share of the weights is left out


@dataclass(frozen=True, slots=True)
class Term:
    """One KPI of a learned index: nothing at `best`, `weight` from `worst` on.

    Args:
        weight: Share of all weights, above 0.
        best: Lowest value of the study, in the unit of the KPI.
        worst: Value that counts in full; far larger ones count no more.
    """

    weight: float
    best: float
    worst: float


@dataclass(frozen=True)
class LearnedCost:
    """Σ of terms, lower is better. Call it with KPIs by name.

    Args:
        terms: KPI name to its term, the heaviest first; the weights sum to 1.
        foretold: Answers that it gave right without having learned them.
        answers: Of so many.
    """

    terms: Mapping[str, Term]
    foretold: int
    answers: int

    def __call__(self, kpis: Mapping[str, float]) -> float:
        """The index of an experiment; a KPI that is not known or infinite counts in full."""
        # fsum: the sum of the exported module, to the last digit, whichever Python runs that.
        return fsum(t.weight * _share(kpis.get(name), t) for name, t in self.terms.items())

    @property
    def explains(self) -> bool:
        """Whether it foretells clearly more than half: by chance it would once in 20 studies."""
        beyond = self.foretold - self.answers / 2
        return bool(beyond > _SURE * np.sqrt(self.answers) / 2)

    @property
    def weights(self) -> Mapping[str, float]:
        """KPI name to its share of all weights, the heaviest first."""
        return {name: term.weight for name, term in self.terms.items()}

    @classmethod
    def of(cls, history: History, seed: int, backend: Backend) -> "LearnedCost | None":
        """Learn it from the answers in `history`; None where KPIs or strict answers are missing.

        Source: none; eq. QP-pref with KPIs in the place of φ, weights 0 or more, and soft.
        Its margins are in `_weights`.
        """
        outcomes, preferences = Outcomes.of(history), history.preferences()
        if not len(outcomes) or not preferences.b.any():
            return None
        weights = _weights(preferences, outcomes.columns, backend)
        if weights.sum() <= 0:
            return None
        weights = np.where(weights < _COUNTS * weights.sum(), 0.0, weights)
        shares = weights / weights.sum()
        order = [int(k) for k in np.argsort(-shares, kind="stable") if shares[k] > 0]
        foretold = _foretold(preferences, outcomes.columns, seed, backend)
        terms = {outcomes.names[k]: Term(float(shares[k]), *outcomes.ranges[k]) for k in order}
        return cls(terms, foretold, int(np.count_nonzero(preferences.b)))

    def to_python(self) -> str:
        """Source of a module with a function `index(kpis)` that needs nothing else."""
        lines = [
            f"    {name!r}: ({term.weight!r}, {term.best!r}, {term.worst!r}),"
            for name, term in self.terms.items()
        ]
        return _MODULE.format(terms="\n".join(lines), foretold=self.foretold, answers=self.answers)


_MODULE = '''"""An index learned from comparisons of experiments; lower is better.

It foretold {foretold} of {answers} answers that it had not learned from.
"""

from math import fsum, inf

TERMS = {{
    # KPI: (weight, best value of the study, value that counts in full)
{terms}
}}


def index(kpis):
    """The index of an experiment, from its KPIs by name; an unknown one counts in full."""
    terms = []
    for name, (weight, best, worst) in TERMS.items():
        share = (kpis.get(name, worst) - best) / (worst - best)
        better = share < 1.0 or kpis.get(name, worst) < best
        terms.append(weight * (max(-1.0, share) if better else 1.0))
    return fsum(terms)
'''


def _share(value: float | None, term: Term) -> float:
    if value is None:
        return 1.0
    share = (value - term.best) / (term.worst - term.best)
    # NaN (unknown, or never) counts in full, unless it is -inf against an infinite worst.
    better = share < 1.0 or value < term.best
    return max(-1.0, share) if better else 1.0


def _weights(
    preferences: Preferences, columns: Float[np.ndarray, "N p"], backend: Backend
) -> Float[np.ndarray, " p"]:
    """w, 0 or more, shape (p,).

    The margin of a comparison is the distance of its two experiments in KPIs. (One margin for
    all takes those that hardly differ, the most towards the end of a study, for the weightiest:
    it found the two KPIs behind the answers in 6 of 10 studies of a toy, this one in 8, and on
    the CSTR ranked other experiments with a correlation of 0.41 with the true index, this 0.60.)
    """
    nothing = np.zeros((len(columns), 0))
    plain = Constraints.of(preferences, nothing, np.ones(len(preferences)))
    constraints = plain.with_outcomes(preferences, columns)
    apart = np.linalg.norm(columns[preferences.first] - columns[preferences.second], axis=1)
    length = np.append(np.maximum(apart, _ALIKE), 1.0)[constraints.owner]  # the last: owner -1
    unit = replace(constraints, rows=constraints.rows / length[:, None])
    return np.asarray(np.maximum(fit(unit, _SOFT, backend), 0.0))


def _foretold(
    preferences: Preferences, columns: Float[np.ndarray, "N p"], seed: int, backend: Backend
) -> int:
    """Strict answers that are given right by weights learned from others (3-fold)."""
    strict = preferences.subset(np.flatnonzero(preferences.b))
    share = np.random.default_rng([seed, len(strict), 2]).permutation(len(strict)) % _FOLDS
    right = 0
    for fold in range(_FOLDS):
        rest, left = strict.subset(np.flatnonzero(share != fold)), np.flatnonzero(share == fold)
        if not len(rest):
            continue
        values = columns @ _weights(rest, columns, backend)
        gap = values[strict.first[left]] - values[strict.second[left]]
        right += int(np.count_nonzero(strict.b[left] * gap > 0))
    return right
