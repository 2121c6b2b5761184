"""The base of agents that use BoTorch."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_agents.optimize.search import Tried
from prefcal_agents.support.extras import load
from prefcal_env.preferences.history import History

from .alone import torch_seeded
from .peer import Peer

T = TypeVar("T")


class BoTorchAgent(Peer):
    """An agent that proposes the first of its candidates that did not run.

    Without such a candidate, or if a fit fails, the sample is random.
    """

    _modules = ("botorch.models.pairwise_gp",)

    def _candidates(self, history: History, seed: int) -> Float[np.ndarray, "r n"] | None:
        """Fit a model to the record; return points of the unit cube, the best first, if any."""
        raise NotImplementedError

    def _proposal(self, history: History, tried: Tried) -> Float[np.ndarray, " n"] | None:
        with torch_seeded(self.setup.seed, history.answered) as seed:
            points = attempted(lambda: self._candidates(history, seed))
        return None if points is None else tried.first_new(np.clip(points, 0.0, 1.0))


def attempted(compute: Callable[[], T]) -> T | None:
    """Return what `compute` returns, or None if a model of BoTorch cannot be fitted or searched.

    Errors of linear algebra in torch and gpytorch are RuntimeErrors; torch's distributions raise
    ValueError for parameters that are NaN after a failed fit.
    """
    errors = load("botorch.exceptions.errors", "peers")
    try:
        return compute()
    except (RuntimeError, ValueError, errors.BotorchError, errors.ModelFittingError):
        return None
