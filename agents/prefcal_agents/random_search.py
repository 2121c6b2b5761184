"""Random search: the agent that learns nothing, to compare the others with."""

from typing import final

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace

from .checks import integer
from .cube import Tried, scaled
from .ledger import Ledger
from .start import Start
from .state import AgentState
from .turn_taking import PreferenceBased
from .turns import Turns

VERSION = 1
"""Of the algorithm: raised when the same answers would lead to another next sample."""


@final
class RandomSearch(PreferenceBased):
    """Sample i is uniform in the cube and depends on `(seed, i)` alone.

    Args:
        space: The knobs.
        n_init: Kept for the contract of all agents; 1 or more.
        n_max: Experiments in all, which take n_max - 1 comparisons.
        seed: Of all randomness, 0 or more.
        start: Physical θ to begin with, the present tuning say, shape (n,), or several.

    Raises:
        SettingsError: an impossible value.
        KnobError: a θ of `start` is outside the space.
    """

    def __init__(
        self,
        space: KnobSpace,
        *,
        n_init: int = 10,
        n_max: int = 50,
        seed: int = 0,
        start: Start | None = None,
    ) -> None:
        integer("seed", seed, low=0)
        self._seed = int(seed)
        self._turns = Turns(space, n_init, n_max, self._propose, start=start)

    def _propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        rng = np.random.default_rng([self._seed, ledger.answered])
        return Tried(self.space, ledger).fresh(
            scaled(self.space, rng.random((1, len(self.space))))[0], rng
        )

    @classmethod
    def restore(cls, space: KnobSpace, state: AgentState) -> "RandomSearch":
        """Carry on from `state`, with the identical next query.

        Raises:
            SettingsError: it is the state of another agent, or does not fit the space.
        """
        state.check("RandomSearch")
        agent = cls(space, n_init=state.n_init, n_max=state.n_max, seed=state.seed)
        agent._turns.load(state.ledger, state.start)
        return agent

    @property
    def state(self) -> AgentState:
        """Everything that has to be saved; the sample of the open query is among it."""
        self._turns.settle()
        return self._snapshot()

    def _snapshot(self) -> AgentState:
        return self._turns.state("RandomSearch", VERSION, self._seed)

    def copy(self) -> "RandomSearch":
        """Return an independent twin, for running ahead on each likely answer."""
        return self.restore(self.space, self._snapshot())
