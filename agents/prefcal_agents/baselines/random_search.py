"""Provide random search: a baseline agent that learns nothing."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import Agent
from prefcal_env.preferences.history import History


@final
class RandomSearch(Agent):
    """Draw each sample uniformly from the cube; sample i depends on `(seed, i)` alone.

    Arguments and errors are those of `Agent`; `n_init` has no effect.
    """

    version: ClassVar[int] = 1

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return a random point of the searched part of the cube."""
        rng = np.random.default_rng([self.setup.seed, history.answered])
        return Tried(self.space, history).fresh(self.space.scaled(rng.random((1, len(self.space))))[0], rng)
