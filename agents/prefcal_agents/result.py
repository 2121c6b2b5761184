"""What is said of a result: which answers carry it, what was wanted, a menu, a smaller change."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp, softmax

from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.preferences.history import History

from .people import Bank, Lessons, Posterior, Scale, Utilities, overtaking, worth

# --- Draws of a whole study at once: what other answers would teach, with nothing drawn again.
#
# The draws after the last answer lie where that record is likely. What would follow from another one
# needs draws elsewhere: those from before the answers, and those after each of them.

_AT_ONCE = 256  # number of draws that are worked out at a time
_STEPS = 30  # steps of the fixed point; each one brings the constants several times nearer


@dataclass(frozen=True, eq=False, slots=True)
class DrawPool:
    """Draws given several records, and what weighs them for any other record (Screening, rule 13)."""

    bank: Bank  # simulated θ, with their KPIs as measured where they ran
    scale: Scale  # how KPIs are measured
    logs: Float[np.ndarray, "m k"]  # log distances of the KPIs that are expected, shape (m, k)
    shown: Int[np.ndarray, " n"]  # row of the bank of each sample, shape (n,)
    utilities: Utilities  # all draws, shape (s,)
    # Logarithm of their density relative to that before any answer, shape (s,)
    density: Float[np.ndarray, " s"]
    told: Lessons  # answers of a record, and the logarithm of their probability in each draw, shape (s,)
    likely: Float[np.ndarray, " s"]

    @classmethod
    def of(
        cls,
        bank: Bank,
        scale: Scale,
        logs: Float[np.ndarray, "m k"],
        given: Sequence[tuple[History, Utilities]],
    ) -> "DrawPool":
        """Return the pool of draws that were made given some records, as many for each.

        Each draw counts as one of the mixture of all distributions that draws were made from. Their
        constants follow from the draws: each is the mean likelihood over the weighted mixture.

        Source: E. Veach, L. J. Guibas, "Optimally combining sampling techniques for Monte Carlo
        rendering" (1995), the balance heuristic; M. R. Shirts, J. D. Chodera, "Statistically optimal
        analysis of samples from multiple equilibrium states" (2008), eq. (11).
        Deviation: the draws are those of Markov chains, not independent.

        Args:
            bank: Simulated θ.
            scale: How KPIs are measured.
            logs: Log distances of the KPIs that are expected, shape (m, k).
            given: Records and draws given each; the samples of the last one are those of all.

        Raises:
            KeyError: If a sample is not in the bank.
        """
        utilities = _join([limit(scale, draws) for _, draws in given])
        shown = bank.rows([sample.theta for sample in given[-1][0].samples])
        last, nothing = Lessons.of(bank, scale, given[-1][0]), np.zeros(len(utilities))
        pool = cls(bank, scale, logs, shown, utilities, nothing, last.first(0), nothing)
        likely = pool.log_likelihoods([record for record, _ in given])
        constants, density = np.zeros((len(given), 1)), pool.density
        for _ in range(_STEPS):
            density = logsumexp(likely - constants, axis=0) - np.log(len(given))
            # Each constant is a mean over all draws, so it improves the density that improves the constants.
            constants = logsumexp(likely - density, axis=1, keepdims=True) - np.log(len(density))
        return replace(pool, density=density, told=last, likely=likely[-1])

    @property
    def parts(self) -> Iterator[Int[np.ndarray, " q"]]:
        """Return some draws at a time: of a long study, all at once would be another 700 MB."""
        count = len(self.utilities)
        return (np.arange(start, min(start + _AT_ONCE, count)) for start in range(0, count, _AT_ONCE))

    def log_answers(self, given: Lessons) -> Iterator[tuple[Int[np.ndarray, " q"], Float[np.ndarray, "q a"]]]:
        """Yield some draws at a time, with the logarithm of the probability of each answer, shape (q, a)."""
        return ((part, Posterior.of(self.utilities.take(part), given).logs) for part in self.parts)

    def log_likelihoods(self, records: Sequence[History]) -> Float[np.ndarray, "r s"]:
        """Return the logarithm of the probability of all answers of each record, shape (r, s)."""
        given = [self.told, *(Lessons.of(self.bank, self.scale, record) for record in records)]
        pairs = np.vstack([np.stack([each.better, each.worse, each.tie], axis=1) for each in given])
        every, where = np.unique(pairs, axis=0, return_inverse=True)
        columns = np.split(where.ravel(), np.cumsum([len(each) for each in given])[:-1])
        parts = zip(columns, given, strict=True)
        strength = np.array([np.bincount(own, each.strength, len(every)) for own, each in parts])
        # Records of one study share nearly all answers: only those that differ are worked out, each once.
        more = strength[1:] - strength[0]
        own = more.any(axis=0)
        better, worse, tie = every.T
        logs = max((each.logs for each in given), key=len)
        new = Lessons(logs, better, worse, tie > 0, np.ones(len(tie))).take(np.flatnonzero(own))
        found = np.tile(self.likely, (len(records), 1))
        for part, each in self.log_answers(new):
            found[:, part] += more[:, own] @ each.T
        return found

    def weights(self, history: History, power: float = 1.0) -> Float[np.ndarray, " s"]:
        """Return how probable each draw is given a record of these samples, shape (s,), in all 1.

        With a `power` below 1 the answers count less, for people who are not of the draws' form.

        Source: P. Grünwald, T. van Ommen, "Inconsistency of Bayesian inference for misspecified
        linear models, and a proposal for repairing it" (2017): the likelihood to a power.
        """
        return self.weigh(power * self.log_likelihoods([history]).T)[:, 0]

    def weigh(self, likely: Float[np.ndarray, "s r"]) -> Float[np.ndarray, "s r"]:
        """Return how probable each draw is given records by their log likelihoods, shape (s, r)."""
        return np.asarray(softmax(likely - self.density[:, None], axis=0))

    def drawn(self, history: History, count: int, power: float = 1.0) -> Utilities:
        """Return `count` draws given a record, the likely ones several times."""
        return self.utilities.take(_pick(self.weights(history, power), count))


def _pick(weights: Float[np.ndarray, " s"], count: int) -> Int[np.ndarray, " q"]:
    """Return `count` draws, the likely ones several times."""
    shares = np.cumsum(weights)
    return np.asarray(np.searchsorted(shares, (np.arange(count) + 0.5) / count * shares[-1]))


def limit(scale: Scale, utilities: Utilities) -> Utilities:
    """Return draws by the limits of a scale, whose good values may be better than when drawn."""
    limits = np.where(np.isfinite(utilities.limits), scale.limits, np.inf)
    return replace(utilities, limits=limits)


def _join(draws: Sequence[Utilities]) -> Utilities:
    return Utilities(*(np.concatenate([getattr(u, f.name) for u in draws]) for f in fields(Utilities)))


# --- Which answers carry the result, and what the open question can still change.
#
# The result of another record is what its answers say, unless the draws, weighted again, hold another
# experiment for noticeably better. Nothing is fitted again.

_SURE = 0.5
"""An experiment that is noticeably better than the best by the answers in this share of the draws or fewer
never takes its place, whatever the draws are."""
_JUDGES = 256  # number of draws that choose among several that take its place
_TOGETHER = 64  # number of answers that are turned at a time, which bounds the memory
_DOUBTFUL = 0.1  # chance of the other answer from which on it tells something that the result rests on one


@dataclass(frozen=True, slots=True)
class Influence:
    """What the result would be if an answer were the other way round."""

    answer: int  # number of the answer, that of its challenger
    reversed: int  # sample that would be the best then
    chance: float  # probability of that other answer, by all answers but this one
    sure: bool  # whether draws leave no doubt about `reversed`

    @property
    def doubtful(self) -> bool:
        """Return whether the other answers leave this one in doubt."""
        return self.chance >= _DOUBTFUL


def influences(pool: DrawPool, history: History) -> tuple[Influence, ...]:
    """Return the influence of each answer that teaches and prefers a side, in the order given."""
    lessons = [(row, c) for row, c in enumerate(history.lessons) if c.after is None and c.answer.preference]
    rows, index = np.array([[row, c.challenger] for row, c in lessons], dtype=np.int64).reshape(-1, 2).T
    weights, chances = np.empty((len(pool.utilities), len(rows))), np.empty(len(rows))
    # What an answer marks as unsafe makes others of it, which go with it.
    marked = [number for number in index.tolist() if history.comparisons[number].answer.marks]
    whole, *alone = pool.log_likelihoods([history, *map(history.retracted, marked)])
    given, without = Lessons.of(pool.bank, pool.scale, history), dict(zip(marked, alone, strict=True))
    for some in np.array_split(np.arange(len(rows)), len(rows) // _TOGETHER + 1):
        told = given.take(rows[some])
        rest = whole[:, None] - _log_likely(pool, told)
        other = rest + _log_likely(pool, replace(told, better=told.worse, worse=told.better))
        for column, number in enumerate(index[some].tolist()):
            rest[:, column] = without.get(number, rest[:, column])
        # Against the record without it: the answer itself must not vouch for itself.
        chances[some] = np.sum(pool.weigh(rest) * np.exp(other - rest), axis=0)
        weights[:, some] = pool.weigh(other)
    bests = [turn(history, number).by_answers or 0 for number in index.tolist()]
    results = _results(pool, weights, bests, history)
    return tuple(
        Influence(number, other, chance, sure)
        for number, chance, (other, sure) in zip(index.tolist(), chances.tolist(), results, strict=True)
    )


def _log_likely(pool: DrawPool, given: Lessons) -> Float[np.ndarray, "s a"]:
    """Return the logarithm of the probability of each answer, times its strength, shape (s, a)."""
    return np.asarray(np.concatenate([logs for _, logs in pool.log_answers(given)]) * given.strength)


def decisive(found: tuple[Influence, ...], best: int) -> Influence | None:
    """Return the influence of the answer that carries the result; None if none alone does.

    Of those that surely change it, if any, it is the one that the other answers support least.
    """
    changing = [each for each in found if each.reversed != best]
    return max(changing, key=lambda each: (each.sure, each.chance), default=None)


def stakes(pool: DrawPool, history: History, incumbent: int) -> float:
    """Return how probably another sample is the best after the answer to the open question.

    Args:
        pool: Draws of the study, with the challenger among the samples.
        history: Samples and answers so far; the next sample is the challenger.
        incumbent: Sample that is the best so far.
    """
    told = (Preference.CHALLENGER, Preference.TIE, Preference.INCUMBENT)
    records = [history.with_answer(Answer(preference), incumbent) for preference in told]
    before, *after = pool.log_likelihoods([history, *records])
    likely = np.exp(np.array(after) - before) @ pool.weigh(before[:, None])[:, 0]
    bests = [record.by_answers or 0 for record in records]
    results = _results(pool, pool.weigh(np.array(after).T), bests, records[0])
    changed = np.array([best != incumbent for best, _ in results])
    # The sum is below 1 where something was unsafe, which each new experiment is better than.
    return float(likely @ changed / likely.sum())


def turn(history: History, index: int) -> History:
    """Return the record as if the other side had been preferred in comparison `index`."""
    given = history.comparisons[index]
    preference = Preference(-int(given.answer.preference or 0))
    other = replace(given, answer=replace(given.answer, preference=preference))
    comparisons = (*history.comparisons[:index], other, *history.comparisons[index + 1 :])
    return replace(history, comparisons=comparisons, leads=())


def _results(
    pool: DrawPool, weights: Float[np.ndarray, "s r"], bests: Sequence[int], history: History
) -> list[tuple[int, bool]]:
    """Return the sample that is the best after each of some records, and whether draws leave no doubt.

    Args:
        pool: Draws of the study.
        weights: How probable each draw is given each record, shape (s, r).
        bests: The best sample by the answers of each.
        history: One of the records; they mark the same samples as unsafe.
    """
    count, better = history.answered, np.zeros((len(bests), history.answered))
    for part in pool.parts:
        costs = pool.utilities.take(part).costs(pool.logs[pool.shown[:count]])
        for best in {*bests}:
            own = np.flatnonzero(np.array(bests) == best)
            better[own] += weights[np.ix_(part, own)].T @ (costs < costs[:, [best]] - 1.0)
    loose = pool.utilities.loose @ weights
    rivals = [overtaking(*each, history) > 0 for each in zip(better, loose.tolist(), strict=True)]
    found = [(best, bool(each.max() < _SURE)) for best, each in zip(bests, better, strict=True)]
    doubted = [k for k, each in enumerate(rivals) if each.any()]
    if not doubted:
        return found
    # Worth is a rank among all simulated θ, so costs of the shown ones alone would not do.
    judges, places = np.unique([_pick(weights[:, k], _JUDGES) for k in doubted], return_inverse=True)
    parts = np.array_split(judges, len(judges) // _AT_ONCE + 1)
    shown = pool.shown[:count]
    value = np.concatenate([worth(pool.utilities.take(part).costs(pool.logs))[:, shown] for part in parts])
    for k, own in zip(doubted, places.reshape(len(doubted), -1), strict=True):
        found[k] = int(np.argmax(np.where(rivals[k], value[own].mean(axis=0), -np.inf))), False
    return found


# --- A menu of three: the result, and two candidates that people like this one might prefer to it.

_OTHERS = 2
_PERHAPS = 0.25  # probability of not being noticeably worse than the result that a candidate must have
_ENOUGH = 0.8  # share of the largest gain that a candidate must have; the one that differs most is taken
_STOPS = 9  # number of places between two candidates at which a third one is sought


def others(
    costs: Float[np.ndarray, "s m"],
    logs: Float[np.ndarray, "m k"],
    usable: Bool[np.ndarray, " m"],
    result: int,
) -> tuple[int, ...]:
    """Return up to two rows that, beside the result, satisfy most of the drawn people.

    A person is satisfied by what is not noticeably worse than the best of all candidates. The next
    row satisfies most of those who are not yet, or nearly so, and of such rows it is the one whose
    KPIs differ most from what is on the menu, in ranks.

    Source: G. L. Nemhauser, L. A. Wolsey, M. L. Fisher, "An analysis of approximations for
    maximizing submodular set functions" (1978): the greedy choice satisfies at least 63 % as many
    people as the best choice.

    Args:
        costs: Cost of each candidate in each draw, shape (s, m).
        logs: Log distances of their KPIs, shape (m, k).
        usable: Candidates that may be on the menu, shape (m,).
        result: Row of the result.
    """
    best = np.where(usable, costs, np.inf).min(axis=1, keepdims=True)
    perhaps = (costs <= costs[:, [result]] + 1.0).mean(axis=0) >= _PERHAPS
    satisfied = (costs <= best + 1.0) & usable
    ranks = np.argsort(np.argsort(logs, axis=0, kind="stable"), axis=0) / len(logs)
    menu = [result]
    for _ in range(_OTHERS):
        gain = perhaps * (satisfied & ~satisfied[:, menu].any(axis=1)[:, None]).mean(axis=0)
        if not gain.any():
            break
        # By the KPI in which they differ most, to the nearest on the menu: a person sees one large
        # difference.
        apart = np.abs(ranks[:, None] - ranks[menu]).max(axis=2, initial=0.0).min(axis=1)
        menu.append(int(np.argmax(np.where(gain >= _ENOUGH * gain.max(), apart, -1.0))))
    return tuple(menu[1:])


def find_unbeaten(kpis: Float[np.ndarray, "m k"], usable: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Return which usable rows have no other one that is better in a KPI and in none worse, shape (m,).

    Args:
        kpis: KPIs, lower is better, shape (m, k).
        usable: Candidates that may be shown, shape (m,).
    """
    found = usable.copy()
    for row in np.flatnonzero(usable):
        rivals, own = kpis[found], kpis[row]
        found[row] = not np.any((rivals <= own).all(axis=1) & (rivals < own).any(axis=1))
    return found


def rows_between(
    kpis: Float[np.ndarray, "m k"], stops: Bool[np.ndarray, " m"], one: int, other: int
) -> tuple[int, ...]:
    """Return rows on the way from row `one` to row `other`, both included, in this order.

    Those between are nearest to places on the straight line of KPIs in ranks, where equal values have
    the same rank.

    Args:
        kpis: KPIs, lower is better, shape (m, k).
        stops: Candidates that may lie between, such as those that `find_unbeaten` returns, shape (m,).
        one: Row where it begins.
        other: Row where it ends.
    """
    ranks = np.zeros(kpis.shape)
    for place, column in enumerate(kpis.T):
        ranks[:, place] = np.unique(column, return_inverse=True)[1]
    from_one = (ranks - ranks[one]) / np.maximum(ranks.max(axis=0), 1.0)
    way = from_one[other]
    # Two rows may read the same in all KPIs: then there is nothing between them.
    along = from_one @ way / (way @ way or 1.0)
    rows = np.flatnonzero(stops & (along > 0.0) & (along < 1.0))
    parts = np.linspace(0.0, 1.0, _STOPS + 2)[1:-1, None, None]
    apart = ((from_one[rows] - parts * way) ** 2).sum(axis=2)
    middle = rows[np.argmin(apart, axis=1)].tolist() if len(rows) else []
    return (one, *dict.fromkeys(middle), other)


# --- The smallest change that is as good as the result: its knobs are put back to where they were.

_WORSE = 0.05  # probability of being noticeably worse than the result up to which a knob is put back


@dataclass(frozen=True, slots=True)
class SmallerChange:
    """The result with some of its knobs as they were."""

    theta: tuple[float, ...]  # θ, physical
    kept: tuple[int, ...]  # numbers of the knobs that are as they were, from 0
    chance: float  # probability that it is noticeably worse than the result


def smaller_change(
    result: Float[np.ndarray, " n"],
    before: Float[np.ndarray, " n"],
    space: KnobSpace,
    chances: Callable[[Float[np.ndarray, "p n"]], Float[np.ndarray, " p"]],
) -> SmallerChange | None:
    """Return the result with knobs put back one after the other, the one noticed least first.

    None if not even one can be. It takes n (n + 1) / 2 values of `chances` or fewer.

    Args:
        result: Physical θ, shape (n,).
        before: θ that it replaces, shape (n,).
        space: Knobs, whose constraints hold for all that is tried.
        chances: Function of physical θ, shape (p, n), that returns how probably each is noticeably
            worse than the result, shape (p,).
    """
    theta, chance = result, 0.0
    while len(left := np.flatnonzero(theta != before)):
        # One row for each knob that is not back yet, with that knob put back.
        tried = np.where(np.eye(len(theta), dtype=bool)[left], before, theta)
        tried = tried[np.atleast_1d(space.allows(tried))]
        found = chances(tried) if len(tried) else np.ones(1)
        first = int(np.argmin(found))
        if found[first] > _WORSE:
            break
        theta, chance = tried[first], float(found[first])
    if np.array_equal(theta, result):
        return None
    return SmallerChange(tuple(theta.tolist()), tuple(np.flatnonzero(theta == before).tolist()), chance)


# --- Which KPIs a person wanted better, with how sure that is.
#
# It is a statement about verdicts, not about the form of a draw, so that orders and trade-offs agree or
# not: whether a worse value would be noticed.

_POWER = 0.5  # power of the answers' likelihood, by which the certainties hold for people unlike the draws
_DRAWS = 1024
_MARKS = np.linspace(0.0, 0.95, 20)
"""Shares of the worse values of a KPI that are tried, the best of them first."""
_CERTAIN = 0.8
"""Certainty from which on a wish is named. 11 of 12 such wishes were the person's own, but only 6 of 15
less sure ones, and none of the 11 limits that were named with them (docs/research/archive.md)."""


def wishes(pool: DrawPool, history: History, spread: Int[np.ndarray, " r"], result: int) -> dict[str, float]:
    """Return how surely the person wanted each KPI better; only those that are sure enough are named.

    Args:
        spread: Rows of the bank that fill the space, shape (r,).
        result: Row of the result.
    """
    usable = spread[~pool.bank.hopeless[spread]]
    if len(usable) < 2 or not history.lessons:
        return {}
    draws = cautious(pool, history)
    found = {name: _certainty(pool, draws, usable, result, k) for k, name in enumerate(pool.scale.names)}
    return {name: certainty for name, certainty in found.items() if certainty >= _CERTAIN}


def cautious(pool: DrawPool, history: History) -> Utilities:
    """Return draws whose certainties hold for people unlike the draws, too."""
    return pool.drawn(history, _DRAWS, _POWER)


def _certainty(pool: DrawPool, draws: Utilities, rows: Int[np.ndarray, " r"], result: int, kpi: int) -> float:
    """Return how surely a worse value would be noticed, all other KPIs the same.

    The value is the first that is sure enough; 0 if there is none, or if no shown run has it or a worse
    one: the person has never judged such a value.
    """
    column = pool.bank.kpis[:, pool.bank.names.index(pool.scale.names[kpi])]
    usual = column[rows]
    worse = np.unique(usual[np.isfinite(usual) & (usual > column[result])])
    if len(worse) < 2 or not np.isfinite(column[result]):
        return 0.0
    values = np.unique(np.quantile(worse, _MARKS))
    logs = np.repeat(pool.logs[[result]], len(values) + 1, axis=0)
    logs[1:, kpi] = np.log(np.maximum(values - pool.scale.good[kpi], pool.scale.floor[kpi]))
    certain = noticed_worse(draws, logs)
    place, shown = int(np.argmax(certain >= _CERTAIN)), column[pool.shown]
    seen = np.any(np.isfinite(shown) & (shown >= values[place]))
    # argmax of nothing is 0: then the smallest worse value is not sure, and the caller leaves it out.
    return float(certain[place]) if seen else 0.0


def noticed_worse(draws: Utilities, logs: Float[np.ndarray, "m k"]) -> Float[np.ndarray, " q"]:
    """Return the share of draws to which each row but the first is noticeably worse than it, shape (q,).

    Args:
        draws: Draws of what the person wants.
        logs: Log distances of the KPIs, shape (m, k), with m = q + 1.
    """
    others = np.arange(1, len(logs))
    gains = draws.gains(draws.levels(logs), np.zeros_like(others), others).sum(axis=0)
    return np.asarray((gains > 1.0).mean(axis=0))
