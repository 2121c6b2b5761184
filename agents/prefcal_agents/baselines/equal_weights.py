"""Provide screening without learning: show the simulated θ in the order of their mean rank."""

from typing import Any, ClassVar, Self, final

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import PreferenceBased
from prefcal_agents.screening.bank import Bank, runnable
from prefcal_agents.screening.simulations import Simulate, Simulations
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.space.start import Start
from prefcal_agents.support.checks import integer
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History


@final
class EqualWeights(PreferenceBased):
    """Simulate a Latin hypercube and show the best of it, all KPIs counting the same.

    Answers only decide which of those shown is kept. It is what `Screening` has to beat.

    Args:
        space: Knobs to tune.
        simulate: Function of a physical θ, shape (n,), that returns KPIs by name, lower is better;
            see `Simulate`. Without it, the agent can only be inspected.
        n_simulated: Number of θ to simulate, 1 or more.
        n_init: Required of all agents, without effect here; 1 or more.
        n_max: Number of experiments shown, which take n_max - 1 comparisons.
        seed: Seed of the Latin hypercube, 0 or more.
        start: Physical θ to show first, such as the current tuning, shape (n,), or several.

    Raises:
        SettingsError: If a value is not valid.
        KnobError: If a θ of `start` is outside the space.
    """

    version: ClassVar[int] = 1

    def __init__(
        self,
        space: KnobSpace,
        *,
        simulate: Simulate | None = None,
        n_simulated: int = 1000,
        n_init: int = 1,
        n_max: int = 11,
        seed: int = 0,
        start: Start | None = None,
    ) -> None:
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed, start=start)
        integer("n_simulated", n_simulated, low=1)
        self._n_simulated = int(n_simulated)
        self._simulations = None if simulate is None else Simulations(simulate)
        self._bank: Bank | None = None

    def with_simulations(self, simulate: Simulate) -> Self:
        """Return a copy that simulates by `simulate`, for example one restored from a file."""
        twin = self.copy()
        twin._simulations, twin._bank = Simulations(simulate), None
        return twin

    @property
    def n_simulated(self) -> int:
        """Return the number of θ that the agent simulates."""
        return self._n_simulated

    @property
    def simulate(self) -> Simulate | None:
        """Return the function that simulates a θ; None for an agent that was restored without."""
        return None if self._simulations is None else self._simulations.simulate

    @property
    def simulations(self) -> Simulations:
        """Return the simulations so far: how many, and how many failed.

        Raises:
            SettingsError: If the agent has no `simulate`.
        """
        if self._simulations is None:
            raise SettingsError("EqualWeights needs simulate, a function of θ that returns KPIs")
        return self._simulations

    @property
    def bank(self) -> Bank:
        """Return the simulated θ; it simulates them if needed."""
        simulations = self.simulations
        if self._bank is None:
            design = latin_hypercube(self.space, self._n_simulated, self._seed)
            z, thetas = runnable(self.space, design)
            self._bank = Bank.of(z, thetas, simulations(thetas))
        return self._bank

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        tried, ranked = Tried(self.space, history), self.bank.z[by_mean_rank(self.bank.kpis)]
        z = tried.first_new(ranked)
        rng = np.random.default_rng([self._seed, history.answered])
        return tried.fresh(ranked[0], rng) if z is None else z

    def _settings(self) -> dict[str, Any]:
        return {"n_simulated": self._n_simulated}

    def _twin(self, state: AgentState) -> Self:
        twin = super()._twin(state)
        twin._simulations, twin._bank = self._simulations, self._bank
        return twin


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
