"""Provide screening without learning: show the simulated θ in the order of their mean rank."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.optimize.search import Tried
from prefcal_agents.screening.simulations import Simulating
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.utility.bank import Bank, columns_of
from prefcal_env.preferences.history import History


@final
class EqualWeights(Simulating):
    """Simulate a Latin hypercube and show the best of it, all KPIs counting the same.

    Answers only decide which of those shown is kept. It is what `Screening` has to beat.

    Arguments and errors are those of `Simulating`; n_max experiments take n_max - 1 comparisons.
    """

    version: ClassVar[int] = 1

    @property
    def bank(self) -> Bank:
        """Return the simulated θ; it simulates them if needed."""
        simulations = self.simulations
        design = latin_hypercube(self.space, self.n_simulated, self.setup.seed)
        z, thetas = self.space.proposals(design)
        return Bank.of(z, thetas, columns_of(simulations(thetas)))

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the simulated point of the lowest mean rank that did not run."""
        bank = self.bank
        ranked = bank.z[by_mean_rank(bank.kpis)]
        z = Tried(self.space, history).first_new(ranked)
        return np.asarray(ranked[0] if z is None else z)


def by_mean_rank(kpis: Float[np.ndarray, "m k"]) -> Int[np.ndarray, " m"]:
    """Return the rows from the lowest mean rank over all KPIs to the highest, shape (m,).

    Equal values share the mean of their ranks; rows with the same mean keep their order.
    """
    columns = [_ranks(column) for column in kpis.T]
    return np.argsort(np.sum(columns, axis=0) + np.zeros(len(kpis)), kind="stable")


def _ranks(values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Return the rank of each value, from 1; equal values share their mean rank."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - (counts - 1) / 2)[places])
