"""Provide a local search: a baseline agent that steps away from the best θ and models nothing."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import Preferences
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import Agent
from prefcal_env.preferences.history import History

_FIRST, _WIDEST = 0.2, 0.5
"""Standard deviation of a step at the start, and the largest one, in the unit cube."""
_GROWTH, _DECAY = 1.5, 0.9
"""Factors of the step after a success and after a failure."""


@final
class StepSearch(Agent):
    """Evolution strategy with one parent, as in docs/own_agent.py, which explains it.

    After `n_init` uniform samples each one is a normal step away from the best so far. Steps grow
    after a success and shrink after a failure.

    Arguments and errors are those of `Agent`.
    """

    version: ClassVar[int] = 1

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return a step from the best so far, or a random point of the start."""
        rng, n = np.random.default_rng([self.setup.seed, history.answered]), len(self.space)
        if history.answered < self.setup.n_init:
            z = rng.random(n)
        else:
            b = Preferences.of(history).b[self.setup.n_init - 1 :]
            step = _FIRST * _GROWTH ** np.sum(b == -1) * _DECAY ** np.sum(b == 1)
            parent = np.array(history.samples[history.incumbent or 0].z)
            z = parent + min(step, _WIDEST) * rng.standard_normal(n)
        return Tried(self.space, history).fresh(np.clip(z, 0.0, 1.0), rng)
