"""How the bank of a screening agent grows: a function of the record, remembered."""

import numpy as np

from prefcal_agents.space.design import latin_hypercube
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .bank import Bank, runnable
from .simulations import Simulations
from .utility import Utilities

_FIRST = 0.5
"""Share of the simulations that are spread over the space before the first question."""


class Growth:
    """The bank after each answer; copies of an agent share it, since it only saves repetition.

    Args:
        space: Knobs to tune.
        simulations: Simulations of the study.
        n_simulated: Number of θ to simulate.
        n_max: Number of experiments shown, over which the later simulations are spread.
        seed: Seed of all randomness.
    """

    def __init__(
        self, space: KnobSpace, simulations: Simulations, n_simulated: int, n_max: int, seed: int
    ) -> None:
        self.simulations = simulations
        self._space, self._seed = space, seed
        self._first = max(int(_FIRST * n_simulated), 1)
        self._each = (n_simulated - self._first) // max(n_max - 1, 1)
        self._banks: dict[History, Bank] = {}

    def bank(self, history: History) -> Bank:
        """Return the θ simulated before the query after `history`."""
        past = history.until(history.answered)
        if past not in self._banks:
            self._banks[past] = self._grown(past)
        return self._banks[past]

    def _grown(self, past: History) -> Bank:
        design = latin_hypercube(self._space, self._first, self._seed)
        z, thetas = runnable(self._space, design)
        if past.samples:
            z = np.vstack([[s.z for s in past.samples], z])
            thetas = np.vstack([[s.theta for s in past.samples], thetas])
        return Bank.of(z, thetas, self.simulations(thetas))

    def utilities(self, history: History) -> Utilities:
        """Return what the answers of `history` say about the bank."""
        return Utilities.of(self.bank(history), history, self._seed)
