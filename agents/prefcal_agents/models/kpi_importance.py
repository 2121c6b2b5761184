"""Which KPIs stand out in the answers: by evidence, not by the largest of equal shares."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.special import betainc, betaln

from prefcal_agents.history.history import History, Preferences

from .interpolant import normalised
from .kpi_model import CEILING

_SURE = 0.9
"""Posterior probability from which on a KPI is said to stand out."""
_NEEDED, _AS_GOOD = 10.0, 2.0
"""How many times likelier two KPIs make the answers than one for both to be named; and how many
times less likely a KPI may make them than the best one to be named with it."""
_NAMED = 3
_FEW = 2  # KPIs that may decide for them to stand out
_FEWEST = 5  # strict answers below which nothing is compared
_SEVERAL, _MIXES = (4, 7), 400  # sizes of the sums of several KPIs, and how many of them are drawn
_ALIKE = 1e-9  # sums that differ by less are equal


@dataclass(frozen=True, slots=True)
class Importance:
    """How far single KPIs account for the strict answers.

    Args:
        agreement: KPI name to the share of the answers that it alone would have given, 0 to 1,
            the largest first; where it is the same on both sides it counts as half.
        named: KPIs that stand out by evidence, three at most; empty where none does.
        answers: Number of strict answers.
    """

    agreement: Mapping[str, float]
    named: tuple[str, ...]
    answers: int

    @classmethod
    def of(cls, history: History, known: Sequence[str] = ()) -> "Importance | None":
        """Compare explanations of the answers in `history`.

        Five explanations are weighed against each other, equally likely beforehand: one KPI
        decides; two count equally; several (4 to 7) do; all do; none does, and the answers are
        tosses of a coin. The first four leave an unknown share of slips ε below one half, so that
        the evidence of h right answers of m is ∫ 2 (1-ε)^h ε^(m-h) dε from 0 to ½. A KPI stands
        out when "one" and "two" together have a posterior probability of 90 %.

        Source: none; Bayes' rule over sums of KPIs with equal shares, on the scale of the learned
        index. How often it names a KPI: docs/research/importance.md.

        Args:
            history: Samples, answers and KPIs.
            known: Names of KPIs, those that a person sees; only these are compared if at least
                two of them differ among the experiments, in this order where they agree alike.

        Returns:
            None where there are no KPIs or no strict answers.
        """
        preferences = history.preferences()
        strict = preferences.subset(np.flatnonzero(preferences.b))
        names, values = _known(history.outcomes(), known)
        if not names or not len(strict):
            return None
        share = np.mean((_signs(strict, values) + 1) / 2, axis=0)
        agreement = {names[k]: float(share[k]) for k in np.argsort(-share, kind="stable")}
        named = _standing_out(strict, values) if len(strict) >= _FEWEST else []
        return cls(agreement, tuple(names[k] for k in named[:_NAMED]), len(strict))


def _known(
    outcomes: Sequence[Mapping[str, float]], known: Sequence[str]
) -> tuple[list[str], Float[np.ndarray, "N p"]]:
    """Names of the KPIs that differ, and their values; NaN where one is missing."""
    found = {}
    for name in sorted({name for outcome in outcomes for name in outcome}):
        values = np.array([outcome.get(name, np.nan) for outcome in outcomes], dtype=float)
        if len(np.unique(values[~np.isnan(values)])) > 1:
            found[name] = values
    shown = [name for name in known if name in found]
    names = shown if len(shown) > 1 else [*shown, *(name for name in found if name not in shown)]
    return names, np.array([found[name] for name in names]).reshape(len(names), len(outcomes)).T


def _signs(strict: Preferences, values: Float[np.ndarray, "N p"]) -> Float[np.ndarray, "M p"]:
    """1 where a KPI speaks for the answer, -1 where against it, 0 where it is silent."""
    first, second = values[strict.first], values[strict.second]
    order = (first > second).astype(float) - (first < second)  # infinite ones do not subtract
    return np.asarray(order * strict.b[:, None])


def _scaled(values: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """One KPI on the scale of the learned index: 0 for the best, 1 for the worst; ½ if missing."""
    shares = np.full(len(values), 0.5)
    there = np.flatnonzero(~np.isnan(values))
    shares[there] = np.where(values[there] > 0, 1.0, 0.0)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite):
        shares[finite] = normalised(values[finite], CEILING)
    return shares


def _standing_out(strict: Preferences, values: Float[np.ndarray, "N p"]) -> list[int]:
    """Columns of the KPIs that decide; none while "one or two decide" is not sure."""
    groups = _alike(_signs(strict, values))
    columns = np.array([_scaled(values[:, group[0]]) for group in groups]).T
    gaps = (columns[strict.first] - columns[strict.second]) * strict.b[:, None]
    explanations = _explanations(len(groups))
    logs = [_evidence(gaps @ sums.T) for sums in explanations]
    means = [np.logaddexp.reduce(log) - np.log(len(log)) for log in logs]
    means.append(-len(gaps) * np.log(2))  # none counts: a coin
    posterior = np.exp(means - np.logaddexp.reduce(means))
    if posterior[: min(_FEW, len(groups))].sum() < _SURE:
        return []
    return [column for k in _deciding(logs, explanations) for column in groups[k]]


def _deciding(logs: list[np.ndarray], explanations: list[np.ndarray]) -> list[int]:
    """One KPI, with those that explain as much alone; two where both are needed.

    Args:
        logs: Of each explanation, the evidence of its s sums, shape (s,).
        explanations: Its sums, shape (s, p).
    """
    alone = logs[0]
    if len(explanations) > 1 and logs[1].max() > alone.max() + np.log(_NEEDED):
        return [int(k) for k in np.flatnonzero(explanations[1][np.argmax(logs[1])])]
    order = np.argsort(-alone, kind="stable")
    return [int(k) for k in order if alone[k] > alone.max() - np.log(_AS_GOOD)]


def _alike(signs: Float[np.ndarray, "M p"]) -> list[list[int]]:
    """Columns that say the same of every answer belong together: nothing tells them apart."""
    groups: dict[tuple[float, ...], list[int]] = {}
    for k, column in enumerate(signs.T):
        groups.setdefault(tuple(column.tolist()), []).append(k)
    return list(groups.values())


def _explanations(p: int) -> list[np.ndarray]:
    """Sums of KPIs as rows of ones and zeros, each shape (s, p): one, two, several, all."""
    one = np.eye(p)
    if p < 2:
        return [one]
    sums = [one, np.array([one[list(pair)].sum(axis=0) for pair in combinations(range(p), 2)])]
    low, high = _SEVERAL[0], min(_SEVERAL[1], p - 1)
    if high >= low:
        rng = np.random.default_rng(0)  # the same sums for everybody: no answer depends on chance
        sizes = rng.integers(low, high + 1, _MIXES)
        chosen = [one[rng.choice(p, size, replace=False)].sum(axis=0) for size in sizes]
        sums.append(np.array(chosen))
    return sums if p == _FEW else [*sums, np.ones((1, p))]


def _evidence(gaps: Float[np.ndarray, "M s"]) -> Float[np.ndarray, " s"]:
    """Logarithm of the probability of all answers under each sum; equal sums toss a coin."""
    right = np.sum(gaps > _ALIKE, axis=0)
    wrong = np.sum(gaps < -_ALIKE, axis=0)
    decided = (wrong + 1, right + 1)
    below_half = np.maximum(betainc(*decided, 0.5), np.finfo(float).tiny)
    undecided = len(gaps) - right - wrong
    return np.asarray(np.log(2 * below_half) + betaln(*decided) - undecided * np.log(2))
