"""Learn from answers: draw costs by how well they explain them, and ask whether they do.

A person may judge by something that no KPI measures. Then a model over θ explains the answers better.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .lessons import Preferences
from .people import REAL, Bank, Mistakes, Scale, Utilities, log_answers, subtract
from .surrogate import predicted

AFTER = 10
"""Number of answers before KPIs can be left; fewer say too little."""


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
        for part in utilities.parts:  # of a long study, all levels at once would be another 70 MB
            level = utilities.level(self.logs, part)
            found[part] = subtract(level, self.better, self.worse, counted[part])
        return found


@dataclass(frozen=True, eq=False, slots=True)
class Posterior:
    """Draws given answers, and what each of them says of each answer.

    Args:
        utilities: s draws.
        lessons: The answers.
        apart: How much better one experiment of each answer is, see `Utilities.differences`, (c, s, a).
        logs: Logarithm of the probability of each answer, see `Utilities.log_answers`, shape (s, a).
    """

    utilities: Utilities
    lessons: Lessons
    apart: Float[np.ndarray, "c s a"]
    logs: Float[np.ndarray, "s a"]

    @classmethod
    def of(cls, utilities: Utilities, lessons: Lessons) -> "Posterior":
        """Return what draws, which are given the answers already, say of them."""
        apart = lessons.differences(utilities)
        return cls(utilities, lessons, apart, utilities.log_answers(apart, lessons.tie))

    def update(
        self, new: Lessons, scale: Scale, rng: np.random.Generator, mistakes: Mistakes = REAL
    ) -> "Posterior":
        """Return draws given the answers `new` instead. Those that both begin with are not worked out again.

        Source: N. Chopin, "A sequential particle filter method for static models" (2002): draws are
        repeated by how well they explain the new answers, then moved by Metropolis steps.
        Deviation: proposals draw from the distribution before any answer, so that the likelihood alone
        decides.
        """
        before, kept = self.utilities, new.shared(self.lessons)
        fresh = new.take(np.arange(kept, len(new)))
        apart = fresh.differences(before)
        logs = np.hstack([self.logs[:, :kept], before.log_answers(apart, fresh.tie)])
        # Only the ratio: the draws already follow the old answers, which may change, too, when one is
        # retracted.
        gained = logs @ new.strength - self.logs @ self.lessons.strength
        shares = np.cumsum(np.exp(gained - gained.max()))
        # Systematic: one random number for all, so that a draw is repeated as often as it should be, to
        # within one.
        places = (rng.random() + np.arange(len(before))) / len(before) * shares[-1]
        rows = np.minimum(np.searchsorted(shares, places), len(before) - 1)
        rows = rng.permutation(rows)
        logs = logs.take(rows, axis=0)
        both = np.empty((len(apart), *logs.shape))
        for part, added in enumerate(apart):  # of a long study, all at once would be another 50 MB
            both[part, :, :kept] = self.apart[part].take(rows, axis=0)[:, :kept]
            both[part, :, kept:] = added.take(rows, axis=0)
        return _move(Posterior(before.take(rows), new, both, logs), scale, rng, mistakes)


def learn(before: Utilities, lessons: Lessons, scale: Scale, rng: np.random.Generator) -> Utilities:
    """Return draws given all answers of `lessons`, one after the other."""
    given = Posterior.of(before, lessons.first(0))
    for count in range(len(lessons)):
        given = given.update(lessons.first(count + 1), scale, rng)
    return given.utilities


_TELLING = 64
"""Number of answers that are looked at first: those that are explained worst refuse nearly all steps that all
answers together refuse."""


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
        changed = subtract(tried.level(given.logs, part, draw), given.better, given.worse, counted)
        before, apart[part, draw] = apart[part, draw], changed
        # All at once where most are wanted; else one by one: to copy theirs takes longer than to add them.
        gains = tried.gain(apart, weights) if 2 * len(rows) > len(tried) else None
        # In parts of 200 kB, which stay in the cache: of a long study, those of all rows are 12 MB.
        found, size = np.empty((len(rows), len(given))), 1 + 2**15 // max(len(given), 1)
        for start in range(0, len(rows), size):
            some = rows[start : start + size]
            gain = gains[some] if gains is not None else tried.gain(apart, weights, some)
            found[start : start + size] = log_answers(gain, given.tie, tried.errors[some, None])
        return found, before


def _move(given: Posterior, scale: Scale, rng: np.random.Generator, mistakes: Mistakes) -> Posterior:
    """Return the draws after Metropolis steps. Only what a step changes is computed again, in `given`.

    Of a long study, a step that a few answers refuse meets no other.
    """
    utilities, logs, told = given.utilities, given.logs, _Told(given.lessons, given.apart)
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
    # Those that marks make are no answers.
    counting = np.flatnonzero(~given.lessons.tie[: len(lessons)])
    # Each answer predicted from the others: the harmonic mean over draws given all answers. A few answers
    # at a time: of a long study, all at once would be another 40 MB.
    parts = np.array_split(counting, len(counting) // 64 + 1)
    means = np.concatenate([logsumexp(-given.logs[:, part], axis=0) for part in parts])
    by_kpis = float(np.sum(np.log(len(given.logs)) - means))
    # By 2 nats: a smaller difference may be chance. The process takes 3 % of the answers for mistakes.
    return bool(predicted(Preferences.of(history), 0.03) <= by_kpis + 2.0)
