"""Learn from answers: draw costs by how well they explain them, and ask whether they do.

A person may judge by something that no KPI measures. Then a model over θ explains the answers
better.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp

from prefcal_agents.history.lessons import Preferences
from prefcal_agents.models.gaussian_process import predicted
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .bank import Bank
from .utilities import Scale, Utilities

DRAWS = 1024
"""Number of draws that stand for what is known."""
_STEPS = 24
"""Metropolis steps of each draw after an answer."""
AFTER = 10
"""Number of answers before KPIs can be left; fewer say too little."""
_MARGIN = 2.0
"""Nats by which θ must predict the answers better than KPIs."""
_ERROR = 0.03
"""Rate of wrong answers of the model over θ."""


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
        given = [
            (v.challenger, v.incumbent, v.preference, c.answer.strength)
            for c in history.lessons()
            if (v := c.verdict) is not None
        ]
        unsafe = history.unsafe()
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

    def log_likelihood(self, utilities: Utilities) -> Float[np.ndarray, " s"]:
        """Return the logarithm of the probability of all answers by each draw, shape (s,)."""
        return np.asarray(self.log_probabilities(utilities) @ self.strength)

    def log_probabilities(self, utilities: Utilities) -> Float[np.ndarray, "s a"]:
        """Return the logarithm of the probability of each answer by each draw, shape (s, a)."""
        return utilities.log_answers(utilities.levels(self.logs), self.better, self.worse, self.tie)


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


def _moved(utilities: Utilities, lessons: Lessons, scale: Scale, rng: np.random.Generator) -> Utilities:
    """Return draws after Metropolis steps. Only what a step changes is computed again."""
    count, k = utilities.normals.shape
    levels = utilities.levels(lessons.logs)
    answers = lessons.better, lessons.worse, lessons.tie
    logs = utilities.log_answers(levels, *answers) @ lessons.strength
    for _ in range(_STEPS):
        new = Utilities.drawn(scale, count, rng, utilities.ordered > 0)
        tried = utilities.mutated(new, rng)
        draw, kpi = np.nonzero(tried.steps != utilities.steps)
        stated = np.isfinite(tried.limits[draw, kpi])
        draw, part = np.append(draw, draw[stated]), np.append(kpi, kpi[stated] + k)
        before = levels[part, draw]
        levels[part, draw] = tried.level(lessons.logs, part, draw)
        likely = tried.log_answers(levels, *answers) @ lessons.strength
        accepted = np.log(rng.random(count)) < likely - logs
        refused = ~accepted[draw]
        levels[part[refused], draw[refused]] = before[refused]
        utilities = utilities.where(accepted, tried)
        logs = np.where(accepted, likely, logs)
    return utilities


def explains(history: History, bank: Bank, scale: Scale, utilities: Utilities) -> bool:
    """Return whether KPIs predict the answers about as well as θ does, or too few are known.

    Source: A. E. Gelfand, D. K. Dey, H. Chang, "Model determination using predictive
    distributions" (1992).

    Args:
        history: Samples and answers.
        bank: KPIs of all samples, and of others.
        scale: How the KPIs are measured.
        utilities: Draws of what the person wants, given the answers.
    """
    lessons = history.lessons()
    if len(lessons) < AFTER or not any(c.answer.preference for c in lessons):
        return True
    known = Lessons.of(bank, scale, history)
    strict = ~known.tie
    strict[len(lessons) :] = False  # those that marks make are no answers
    logs = known.log_probabilities(utilities)[:, strict]
    # Each answer predicted from the others: the harmonic mean over draws given all answers.
    by_kpis = float(np.sum(np.log(len(logs)) - logsumexp(-logs, axis=0)))
    return bool(predicted(Preferences.of(history), _ERROR) <= by_kpis + _MARGIN)
