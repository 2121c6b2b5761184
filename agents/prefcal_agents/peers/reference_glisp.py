"""Provide the reference implementation of GLISp, package `glis`, as an agent."""

from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import Preferences, cube_of
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import PreferenceBased
from prefcal_agents.support.extras import load
from prefcal_agents.support.global_random import seeded
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .solvers import cube_solver, design


@final
class ReferenceGLISp(PreferenceBased):
    """GLISp as published by its authors, with the package's own settings.

    The package owns its state. Here its solver is set up again for each proposal from the stored
    samples and the valid answers, so nothing else has to be stored. It ignores abstentions, which
    it does not support.

    Source: package `glis` 2.0.2 by Bemporad and Zhu.
    Deviation: its random generator is seeded for each proposal; it searches the unit cube, and
    integers are snapped afterwards.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the package's Latin hypercube, 1 or more (it uses at least 2).
        n_max: Number of experiments, which take n_max - 1 comparisons.
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
        self._thetas: dict[History, float] = {}

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        index, start = history.answered, max(self.n_init, 2)
        if index < start:
            with seeded(self._seed, 0):
                z = design(self._package.GLISp, len(self.space), start)[index]
        else:
            theta = self._theta(history)
            solver = self._solver(history, RBFcalibrate=False, thetas=np.array([theta]))
            with seeded(self._seed, index):
                # The tie reported here is not added to its lists; it learns from them and proposes.
                z = solver.update(0)
        rng = np.random.default_rng([self._seed, index])
        return Tried(self.space, history).fresh(np.clip(z, 0.0, 1.0), rng)

    def _solver(self, history: History, **options: Any) -> Any:
        """Return the package's solver in its state after running the last sample of `history`."""
        z = cube_of(history)
        solver = cube_solver(self._package.GLISp, z, expected_max_evals=self.n_max, **options)
        solver.initialize()
        lessons = Preferences.of(history)
        pairs = zip(lessons.b, lessons.first, lessons.second, strict=True)
        answers = [(int(b), int(first), int(second)) for b, first, second in pairs]
        solver.I = _Full([a, b] if won < 0 else [b, a] for won, a, b in answers if won)
        solver.Ieq = _Full([a, b] for won, a, b in answers if not won)
        solver.iter, solver.ibest, solver.xnext = len(z) - 1, history.incumbent, z[-1]
        return solver

    def _theta(self, history: History) -> float:
        """Return θ, the package's factor on ε, from its last validation before the next sample."""
        start = max(self.n_init, 2)
        quarters = [round(k * (self.n_max - start) / 4) for k in (0, 1, 2, 3)]
        past = history.until(max(start + q for q in quarters if start + q <= history.answered))
        if past not in self._thetas:
            solver = self._solver(past)
            if len(Preferences.of(past)):
                solver.rbf_calibrate(2 * cube_of(past) - 1)
            self._thetas[past] = float(solver.theta)
        return self._thetas[past]


class _Full(list[list[int]]):
    """A list that ignores everything that is appended."""

    def append(self, _: list[int]) -> None:
        """Do nothing."""
