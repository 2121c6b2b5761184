"""Provide the reference implementation of GLIS, package `glis`, as a value-based agent."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import cube_of, scores_of
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import ValueBased
from prefcal_agents.support.extras import load
from prefcal_agents.support.global_random import seeded
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .solvers import cube_solver, design


@final
class ReferenceGLIS(ValueBased):
    """GLIS as published by its authors, with the package's own settings.

    It is set up again for each proposal, like `ReferenceGLISp`. Experiments without a score are
    left out.

    Source: package `glis` 2.0.2 by Bemporad and Zhu.
    Deviation: its random generator is seeded for each proposal; it searches the unit cube, and
    integers are snapped afterwards; scores are divided by a power of 2, which changes no proposal
    and avoids overflow.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the package's Latin hypercube, 1 or more.
        n_max: Number of experiments.
        seed: Seed of all randomness, 0 or more.

    Raises:
        SettingsError: If a value is not valid.
        MissingExtraError: If the extra `peers` is not installed.
    """

    version: ClassVar[int] = 1

    def __init__(
        self, space: KnobSpace, *, n_init: int = 10, n_max: int = 50, seed: int = 0
    ) -> None:
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        self._package = load("glis.solvers", "peers")

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        index, n = history.answered, len(self.space)
        rng = np.random.default_rng([self._seed, index])
        scored, values = scores_of(history)
        if index < self.n_init:
            with seeded(self._seed, 0):
                z = design(self._package.GLIS, n, self.n_init)[index]
        elif not len(scored):
            z = rng.random(n)
        else:
            solver = cube_solver(self._package.GLIS, cube_of(history)[scored])
            solver.initialize()
            _, exponent = np.frexp(np.abs(values).max())
            with seeded(self._seed, index):
                for value in np.ldexp(values, -exponent):
                    z = solver.update(value)
        return Tried(self.space, history).fresh(np.clip(z, 0.0, 1.0), rng)
