"""Learn from answers: draw costs by how well they explain them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .bank import Bank
from .utility import Scale, Utilities

DRAWS = 128
"""Number of draws that stand for what is known."""
_CANDIDATES = 12_000
"""Number of draws before the answers, from which those are taken that explain them best."""
_STEPS = 20
"""Metropolis steps of each draw after that."""
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
    better: np.ndarray
    worse: np.ndarray
    tie: np.ndarray
    strength: np.ndarray

    @classmethod
    def of(cls, bank: Bank, scale: Scale, history: History) -> "Lessons":
        """Return the answers of `history`; an unsafe experiment is worse than all that are not."""
        logs = scale(bank.kpis)
        rows = [bank.find(sample.theta) for sample in history.samples[: history.answered]]
        typical = np.flatnonzero(np.isfinite(logs).all(axis=1))[:_TYPICAL]
        given = [(v.challenger, v.incumbent, v.preference, c.answer.strength)
                 for c in history.lessons() if (v := c.verdict) is not None]  # fmt: skip
        unsafe = history.unsafe()
        given += [(i, j, Preference.CHALLENGER, 1.0)
                  for j in sorted(unsafe) for i in range(len(rows)) if i not in unsafe]  # fmt: skip
        turned = [(b, a) if p is Preference.INCUMBENT else (a, b) for a, b, p, _ in given]
        pairs = np.array(turned, dtype=np.int64).reshape(-1, 2)
        return cls(
            np.vstack([logs[rows], logs[typical]]),
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
        costs = utilities.costs(self.logs)
        gain = costs[:, self.worse] - costs[:, self.better]
        gain /= noticeable(costs[:, self.shown :])[:, None]
        error = utilities.errors[:, None]
        won = error + (1.0 - 2.0 * error) * ndtr(gain)
        alike = _CARELESS + (1.0 - _CARELESS) * np.exp(-0.5 * (gain * NOTICED / _ALIKE) ** 2)
        return np.asarray(np.log(np.where(self.tie, alike, won)) @ self.strength)


def noticeable(costs: Float[np.ndarray, "s t"]) -> Float[np.ndarray, " s"]:
    """Return the difference that is just noticed, given costs of typical experiments, (s,)."""
    if not costs.shape[1]:
        return np.full(len(costs), NOTICED)
    return np.asarray(NOTICED * costs.std(axis=1) + 1e-9)


def posterior(
    scale: Scale, lessons: Lessons, rng: np.random.Generator
) -> Utilities:
    """Return `DRAWS` draws of the person's cost, given the answers.

    Source: none; sampling importance resampling, then Metropolis steps with proposals from the
    distribution before the answers, so that the likelihood alone decides.
    """
    if not len(lessons):
        return Utilities.drawn(scale, DRAWS, rng)
    utilities = Utilities.drawn(scale, _CANDIDATES, rng)
    logs = lessons.log_likelihood(utilities)
    shares = np.cumsum(np.exp(logs - logs.max()))
    places = (rng.random() + np.arange(DRAWS)) / DRAWS * shares[-1]
    rows = np.minimum(np.searchsorted(shares, places), _CANDIDATES - 1)
    utilities, logs = utilities.take(rows), logs[rows]
    for _ in range(_STEPS):
        tried = utilities.mutated(Utilities.drawn(scale, DRAWS, rng), rng)
        new = lessons.log_likelihood(tried)
        accepted = np.log(rng.random(DRAWS)) < new - logs
        utilities = utilities.where(accepted, tried)
        logs = np.where(accepted, new, logs)
    return utilities
