"""Find the KPIs that matter most in the answers, by comparing explanations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.special import betainc, betaln

from prefcal_agents.history.lessons import Preferences, kpis_of
from prefcal_env.preferences.history import History
from prefcal_env.preferences.reading import Reading

from .interpolant import normalized
from .kpi_model import CEILING

_SURE = 0.9
"""Minimum posterior probability for saying that a KPI stands out."""
_NEEDED, _AS_GOOD = 10.0, 2.0
"""How many times likelier the answers must be under two KPIs than under one to name both; and how
many times less likely they may be under another KPI than under the best one to name it too."""
_NAMED = 3
_FEW = 2  # maximum number of KPIs that decide together and still stand out
FEWEST = 8
"""Minimum number of strict answers for a comparison of KPIs; below, nothing is said about them."""
_SEVERAL, _MIXES = (4, 7), 400  # sizes of the sums of several KPIs, and number of sums drawn
_ALIKE = 1e-9  # sums that differ by less count as equal


@dataclass(frozen=True, slots=True)
class Importance:
    """How well single KPIs explain the strict answers.

    Args:
        agreement: KPI name to the share of answers that it alone would have given, 0 to 1,
            largest first; an answer counts half if both sides have the same value.
        named: KPIs that stand out, three at most; empty if none does.
        answers: Number of strict answers.
    """

    agreement: Mapping[str, float]
    named: tuple[str, ...]
    answers: int

    @classmethod
    def of(
        cls, history: History, known: Sequence[str] = (), reading: Reading | None = None
    ) -> "Importance | None":
        """Compare explanations of the answers in `history`.

        Five explanations compete, equally likely a priori: one KPI decides; two count equally;
        several (4 to 7) do; all do; none does, and the answers are coin tosses. The first four
        allow an unknown error rate ε below one half, so the evidence of h right answers of m is
        ∫ 2 (1-ε)^h ε^(m-h) dε from 0 to ½. A KPI stands out when "one" and "two" together have a
        posterior probability of 90 %.

        Source: none; Bayes' rule over sums of KPIs with equal shares, on the scale of the learned
        index. How often it names a KPI: docs/research/archive.md.

        Args:
            history: Samples, answers and KPIs.
            known: Names of the KPIs that the person sees. If at least two of them differ among
                the experiments, only these are compared; their order breaks ties.
            reading: How the person reads KPIs; exactly if None.

        Returns:
            The importance; None without KPIs or strict answers.
        """
        preferences = Preferences.of(history)
        strict = preferences.subset(np.flatnonzero(preferences.b))
        names, values = _known(kpis_of(history), known, reading or Reading())
        if not names or not len(strict):
            return None
        share = np.mean((_signs(strict, values) + 1) / 2, axis=0)
        agreement = {names[k]: float(share[k]) for k in np.argsort(-share, kind="stable")}
        named = _standing_out(strict, values) if len(strict) >= FEWEST else []
        return cls(agreement, tuple(names[k] for k in named[:_NAMED]), len(strict))


def _known(
    outcomes: Sequence[Mapping[str, float]], known: Sequence[str], reading: Reading
) -> tuple[list[str], Float[np.ndarray, "N p"]]:
    """Return the names of the KPIs that differ, and their values; NaN if missing."""
    found = {}
    for name in sorted({name for outcome in outcomes for name in outcome}):
        exact = np.array([outcome.get(name, np.nan) for outcome in outcomes], dtype=float)
        values = reading(name, exact)
        if len(np.unique(values[~np.isnan(values)])) > 1:
            found[name] = values
    shown = [name for name in known if name in found]
    names = shown if len(shown) > 1 else [*shown, *(name for name in found if name not in shown)]
    return names, np.array([found[name] for name in names]).reshape(len(names), len(outcomes)).T


def _signs(strict: Preferences, values: Float[np.ndarray, "N p"]) -> Float[np.ndarray, "M p"]:
    """Return 1 if a KPI supports the answer, -1 if it contradicts it, 0 if it is equal."""
    first, second = values[strict.first], values[strict.second]
    order = (first > second).astype(float) - (first < second)  # works for infinite values
    return np.asarray(order * strict.b[:, None])


def _scaled(values: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Return a KPI scaled as in the learned index: best 0, worst 1, missing ½."""
    shares = np.full(len(values), 0.5)
    there = np.flatnonzero(~np.isnan(values))
    shares[there] = np.where(values[there] > 0, 1.0, 0.0)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite):
        shares[finite] = normalized(values[finite], CEILING)
    return shares


def _standing_out(strict: Preferences, values: Float[np.ndarray, "N p"]) -> list[int]:
    """Return the columns of the KPIs that decide; none if that is not certain enough."""
    groups = _alike(_signs(strict, values))
    columns = np.array([_scaled(values[:, group[0]]) for group in groups]).T
    gaps = (columns[strict.first] - columns[strict.second]) * strict.b[:, None]
    explanations = _explanations(len(groups))
    logs = [_evidence(gaps @ sums.T) for sums in explanations]
    means = [np.logaddexp.reduce(log) - np.log(len(log)) for log in logs]
    means.append(-len(gaps) * np.log(2))  # no KPI counts: coin tosses
    posterior = np.exp(means - np.logaddexp.reduce(means))
    if posterior[: min(_FEW, len(groups))].sum() < _SURE:
        return []
    return [column for k in _deciding(logs, explanations) for column in groups[k]]


def _deciding(logs: list[np.ndarray], explanations: list[np.ndarray]) -> list[int]:
    """Return one KPI and those that explain as much alone, or two KPIs if both are needed.

    Args:
        logs: Evidence of the s sums of each explanation, shape (s,).
        explanations: Sums of each explanation, shape (s, p).
    """
    alone = logs[0]
    if len(explanations) > 1 and logs[1].max() > alone.max() + np.log(_NEEDED):
        return [int(k) for k in np.flatnonzero(explanations[1][np.argmax(logs[1])])]
    order = np.argsort(-alone, kind="stable")
    return [int(k) for k in order if alone[k] > alone.max() - np.log(_AS_GOOD)]


def _alike(signs: Float[np.ndarray, "M p"]) -> list[list[int]]:
    """Return groups of columns that agree on every answer, which nothing can tell apart."""
    groups: dict[tuple[float, ...], list[int]] = {}
    for k, column in enumerate(signs.T):
        groups.setdefault(tuple(column.tolist()), []).append(k)
    return list(groups.values())


def _explanations(p: int) -> list[np.ndarray]:
    """Return sums of one, two, several and all KPIs, as rows of ones and zeros, shape (s, p)."""
    one = np.eye(p)
    if p < 2:
        return [one]
    sums = [one, np.array([one[list(pair)].sum(axis=0) for pair in combinations(range(p), 2)])]
    low, high = _SEVERAL[0], min(_SEVERAL[1], p - 1)
    if high >= low:
        rng = np.random.default_rng(0)  # fixed seed: the result is deterministic
        sizes = rng.integers(low, high + 1, _MIXES)
        chosen = [one[rng.choice(p, size, replace=False)].sum(axis=0) for size in sizes]
        sums.append(np.array(chosen))
    return sums if p == _FEW else [*sums, np.ones((1, p))]


def _evidence(gaps: Float[np.ndarray, "M s"]) -> Float[np.ndarray, " s"]:
    """Return the log probability of all answers under each sum; equal sums are coin tosses."""
    right = np.sum(gaps > _ALIKE, axis=0)
    wrong = np.sum(gaps < -_ALIKE, axis=0)
    decided = (wrong + 1, right + 1)
    below_half = np.maximum(betainc(*decided, 0.5), np.finfo(float).tiny)
    undecided = len(gaps) - right - wrong
    return np.asarray(np.log(2 * below_half) + betaln(*decided) - undecided * np.log(2))
