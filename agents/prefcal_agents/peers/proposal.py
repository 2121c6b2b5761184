"""Turn the candidates of a BoTorch model into the next sample of an agent."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_agents.optimize.search import Tried
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.support.extras import load
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .alone import torch_seeded

T = TypeVar("T")
Candidates = Callable[[History, int], Float[np.ndarray, "r n"] | None]
"""Function of the record and a seed that returns points of the unit cube, the best first."""


def proposed(
    space: KnobSpace, history: History, candidates: Candidates, n_init: int, seed: int
) -> Float[np.ndarray, " n"]:
    """Return the next sample, a point of the unit cube, shape (n,).

    It is the first of the candidates that did not run. The first `n_init` samples are a Latin
    hypercube instead. Without such a candidate, or if a fit fails, the sample is random.

    Args:
        space: Knobs to tune.
        history: Record of the study.
        candidates: Function that fits a model to the record and searches the cube.
        n_init: Number of samples of the start, 1 or more.
        seed: Seed of the agent, 0 or more.
    """
    index = history.answered
    rng, tried = np.random.default_rng([seed, index]), Tried(space, history)
    z: Float[np.ndarray, " n"] | None = None
    if index < n_init:
        z = latin_hypercube(space, n_init, seed)[index]
    else:
        with torch_seeded(seed, index) as library_seed:
            points = attempted(lambda: candidates(history, library_seed))
        if points is not None:
            z = tried.first_new(np.clip(points, 0.0, 1.0))
    return tried.fresh(rng.random(len(space)) if z is None else z, rng)


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
