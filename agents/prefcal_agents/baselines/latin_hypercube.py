"""Provide an agent that spreads all experiments as one Latin hypercube and learns nothing."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_agents.space.design import latin_hypercube
from prefcal_env.preferences.history import History


@final
class LatinHypercube(Agent):
    """Spread all `n_max` samples as one Latin hypercube, drawn from `seed` alone.

    Arguments and errors are those of `Agent`; `n_init` has no effect.
    """

    version: ClassVar[int] = 1

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point of the design."""
        design = latin_hypercube(self.space, self._most(history), self.setup.seed)
        return np.asarray(design[history.answered])
