"""Draws of a whole study at once: what other answers would teach, with nothing drawn again.

The draws after the last answer lie where that record is likely. What would follow from another one
needs draws elsewhere: those from before the answers, and those after each of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp, softmax

from prefcal_env.preferences.history import History

from .bank import Bank
from .posterior import Lessons
from .utilities import Scale, Utilities

_STEPS = 30
"""Steps of the fixed point; each one brings the constants several times nearer."""


@dataclass(frozen=True, eq=False, slots=True)
class Pool:
    """Draws given several records, and what weighs them for any other record.

    Args:
        bank: Simulated θ, with their KPIs as measured where they ran.
        scale: How KPIs are measured.
        logs: Log distances of the KPIs that are expected, shape (m, k).
        shown: Row of the bank of each sample, shape (n,).
        utilities: All draws, shape (s,).
        levels: Levels of the samples in each draw, shape (2k, s, n).
        costs: Their costs, shape (s, n).
        density: Logarithm of their density relative to that before any answer, shape (s,).
    """

    bank: Bank
    scale: Scale
    logs: Float[np.ndarray, "m k"]
    shown: Int[np.ndarray, " n"]
    utilities: Utilities
    levels: Float[np.ndarray, "c s n"]
    costs: Float[np.ndarray, "s n"]
    density: Float[np.ndarray, " s"]

    @classmethod
    def of(
        cls,
        bank: Bank,
        scale: Scale,
        logs: Float[np.ndarray, "m k"],
        given: Sequence[tuple[History, Utilities]],
    ) -> "Pool":
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
        utilities = _joined([_within(scale, draws) for _, draws in given])
        shown = np.array([bank.find(sample.theta) for sample in given[-1][0].samples], dtype=np.int64)
        levels = utilities.levels(scale(bank, shown.tolist()))
        costs = utilities.costs(logs[shown])
        pool = cls(bank, scale, logs, shown, utilities, levels, costs, np.zeros(len(utilities)))
        likely = np.array([pool.log_likelihood(record) for record, _ in given])
        constants, density = np.zeros((len(given), 1)), pool.density
        for _ in range(_STEPS):
            density = logsumexp(likely - constants, axis=0) - np.log(len(given))
            constants = logsumexp(likely - density, axis=1, keepdims=True) - np.log(len(density))
        return replace(pool, density=density)

    def log_likelihood(self, history: History) -> Float[np.ndarray, " s"]:
        """Return the logarithm of the probability of all answers of a record, shape (s,)."""
        given = Lessons.of(self.bank, self.scale, history)
        logs = self.utilities.log_answers(self.levels, given.better, given.worse, given.tie)
        return np.asarray(logs @ given.strength)

    def weights(self, history: History, power: float = 1.0) -> Float[np.ndarray, " s"]:
        """Return how probable each draw is given a record of these samples, shape (s,), in all 1.

        With a `power` below 1 the answers count less, for people who are not of the draws' form.

        Source: P. Grünwald, T. van Ommen, "Inconsistency of Bayesian inference for misspecified
        linear models, and a proposal for repairing it" (2017): the likelihood to a power.
        """
        return np.asarray(softmax(power * self.log_likelihood(history) - self.density))

    def drawn(self, history: History, count: int, power: float = 1.0) -> Utilities:
        """Return `count` draws given a record, the likely ones several times."""
        shares = np.cumsum(self.weights(history, power))
        places = (np.arange(count) + 0.5) / count * shares[-1]
        return self.utilities.take(np.searchsorted(shares, places))


def _within(scale: Scale, utilities: Utilities) -> Utilities:
    """Return draws by the limits of a scale, whose good values may be better than when drawn."""
    limits = np.where(np.isfinite(utilities.limits), scale.limits, np.inf)
    return replace(utilities, limits=limits)


def _joined(draws: Sequence[Utilities]) -> Utilities:
    return Utilities(*(np.concatenate([getattr(u, f.name) for u in draws]) for f in fields(Utilities)))
