"""Provide an agent that spreads all experiments as one Latin hypercube and learns nothing."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import PreferenceBased
from prefcal_agents.space.design import latin_hypercube
from prefcal_env.preferences.history import History


@final
class LatinHypercube(PreferenceBased):
    """Spread all `n_max` samples as one Latin hypercube, drawn from `seed` alone.

    Arguments and errors are those of `Agent`; `n_init` has no effect.
    """

    version: ClassVar[int] = 1

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        planned = latin_hypercube(self.space, self.n_max, self._seed)[history.answered]
        return self._fresh(history, planned)
