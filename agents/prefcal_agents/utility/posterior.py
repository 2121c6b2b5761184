"""Learn from answers: draw costs by how well they explain them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit, ndtr

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .bank import Bank
from .utilities import Scale, Utilities

DRAWS = 1024
"""Number of draws that stand for what is known."""
_STEPS = 10
"""Metropolis steps of each draw after an answer."""
NOTICED = 0.05
"""Difference of two costs that is just noticed, in standard deviations of random experiments."""
_ALIKE = 0.1
"""The same for a tie: experiments that differ by this much are hardly called alike."""
_CARELESS = 0.05
"""Probability of a tie between experiments that differ."""
_TYPICAL = 32
"""Number of experiments that give the standard deviation."""


@dataclass(frozen=True, eq=False, slots=True)
class Lessons:
    """Answers as arrays, about experiments given by their log distances.

    Args:
        logs: Log distances of the shown experiments, then of typical ones, shape (p + t, k).
        shown: Number p of shown experiments.
        better: Row of one experiment of each answer, the preferred one unless it is a tie, (a,).
        worse: Row of the other one, shape (a,).
        tie: Whether they are alike, shape (a,).
        strength: Weight c_h of each answer as in eq. QP-pref, shape (a,).
    """

    logs: Float[np.ndarray, "r k"]
    shown: int
    better: Int[np.ndarray, " a"]
    worse: Int[np.ndarray, " a"]
    tie: Bool[np.ndarray, " a"]
    strength: Float[np.ndarray, " a"]

    @classmethod
    def of(cls, bank: Bank, scale: Scale, history: History) -> "Lessons":
        """Return the answers of `history`.

        An unsafe experiment is worse than all others that a person looked at.
        """
        logs = scale(bank)
        rows = [bank.find(sample.theta) for sample in history.samples[: history.answered]]
        given = [(v.challenger, v.incumbent, v.preference, c.answer.strength)
                 for c in history.lessons() if (v := c.verdict) is not None]  # fmt: skip
        unsafe = history.unsafe()
        seen = {i for c in history.counting if c.incumbent is not None
                for i in (c.challenger, c.incumbent)}  # fmt: skip
        given += [(i, j, Preference.CHALLENGER, 1.0)
                  for j in sorted(unsafe) for i in sorted(seen - unsafe)]  # fmt: skip
        turned = [(b, a) if p is Preference.INCUMBENT else (a, b) for a, b, p, _ in given]
        pairs = np.array(turned, dtype=np.int64).reshape(-1, 2)
        return cls(
            np.vstack([logs[rows], logs[typical(logs)]]),
            len(rows),
            pairs[:, 0],
            pairs[:, 1],
            np.array([p is Preference.TIE for _, _, p, _ in given], dtype=np.bool_),
            np.array([strength for *_, strength in given], dtype=float),
        )

    def __len__(self) -> int:
        return len(self.tie)

    def log_likelihood(self, utilities: Utilities) -> Float[np.ndarray, " s"]:
        """Return the logarithm of the probability of all answers by each draw, shape (s,)."""
        return np.asarray(self.log_probabilities(utilities) @ self.strength)

    def log_probabilities(self, utilities: Utilities) -> Float[np.ndarray, "s a"]:
        """Return the logarithm of the probability of each answer by each draw, shape (s, a)."""
        return self.judged(utilities, utilities.costs(self.logs))

    def judged(
        self, utilities: Utilities, costs: Float[np.ndarray, "s r"]
    ) -> Float[np.ndarray, "s a"]:
        """Return the same, given the costs of all rows in each draw."""
        gain = costs[:, self.worse] - costs[:, self.better]
        gain /= noticeable(costs[:, self.shown :])[:, None]
        error = utilities.errors[:, None]
        won = error + (1.0 - 2.0 * error) * ndtr(gain)
        alike = _CARELESS + (1.0 - _CARELESS) * np.exp(-0.5 * (gain * NOTICED / _ALIKE) ** 2)
        return np.asarray(np.log(np.where(self.tie, alike, won)))


def typical(logs: Float[np.ndarray, "m k"]) -> Int[np.ndarray, " t"]:
    """Return the rows of some random experiments that were not interrupted, shape (t,)."""
    return np.flatnonzero(np.isfinite(logs).all(axis=1))[:_TYPICAL]


def noticeable(costs: Float[np.ndarray, "s t"]) -> Float[np.ndarray, " s"]:
    """Return the difference that is just noticed, given costs of typical experiments, (s,)."""
    if not costs.shape[1]:
        return np.full(len(costs), NOTICED)
    return np.asarray(NOTICED * costs.std(axis=1) + 1e-9)


def updated(
    before: Utilities, old: Lessons, new: Lessons, scale: Scale, rng: np.random.Generator
) -> Utilities:
    """Return draws given the answers `new`, from draws given the answers `old`.

    Source: N. Chopin, "A sequential particle filter method for static models" (2002): draws are
    repeated by how well they explain the new answers, then moved by Metropolis steps.
    Deviation: proposals draw from the distribution before any answer, so that the likelihood alone
    decides.
    """
    gained = new.log_likelihood(before) - old.log_likelihood(before)
    shares = np.cumsum(np.exp(gained - gained.max()))
    places = (rng.random() + np.arange(len(before))) / len(before) * shares[-1]
    rows = np.minimum(np.searchsorted(shares, places), len(before) - 1)
    utilities = before.take(rng.permutation(rows))
    return _moved(utilities, new, scale, rng)


def _moved(
    utilities: Utilities, lessons: Lessons, scale: Scale, rng: np.random.Generator
) -> Utilities:
    """Return draws after Metropolis steps. Only what a step changes is computed again."""
    count, k = utilities.normals.shape
    each = [utilities.losses(lessons.logs, kpi) for kpi in range(k)]
    losses = np.array(each).reshape(k, count, len(lessons.logs))

    def log_likelihood(of: Utilities) -> Float[np.ndarray, " s"]:
        costs = of.added(np.zeros((count, len(lessons.logs))), losses)
        return np.asarray(lessons.judged(of, costs) @ lessons.strength)

    logs = log_likelihood(utilities)
    for _ in range(_STEPS):
        tried = utilities.mutated(Utilities.drawn(scale, count, rng), rng)
        draw, kpi = np.nonzero(
            (tried.scales != utilities.scales) | (tried.exponents != utilities.exponents)
        )
        before = losses[kpi, draw]
        steps = lessons.logs.T[kpi] - tried.scales[draw, kpi, None]
        losses[kpi, draw] = expit(tried.exponents[draw, kpi, None] * steps)
        likely = log_likelihood(tried)
        accepted = np.log(rng.random(count)) < likely - logs
        refused = ~accepted[draw]
        losses[kpi[refused], draw[refused]] = before[refused]
        utilities = utilities.where(accepted, tried)
        logs = np.where(accepted, likely, logs)
    return utilities
