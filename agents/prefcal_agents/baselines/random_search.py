"""Provide random search: a baseline agent that learns nothing."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import PreferenceBased
from prefcal_env.preferences.history import History


@final
class RandomSearch(PreferenceBased):
    """Draw each sample uniformly from the cube; sample i depends on `(seed, i)` alone.

    Args:
        space: Knobs to tune.
        n_init: Required of all agents, without effect here; 1 or more.
        n_max: Number of experiments, which take n_max - 1 comparisons.
        seed: Seed of all randomness, 0 or more.
        start: Physical θ to start from, such as the current tuning, shape (n,), or several.

    Raises:
        SettingsError: If a value is not valid.
        KnobError: If a θ of `start` is outside the space.
    """

    version: ClassVar[int] = 1

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        rng = np.random.default_rng([self._seed, history.answered])
        return Tried(self.space, history).fresh(
            self.space.scaled(rng.random((1, len(self.space))))[0], rng
        )
