"""Provide the reference implementations of GLIS and GLISp, package `glis`, as agents."""

from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.lessons import Preferences, cube_of, scores_of
from prefcal_agents.search import Tried
from prefcal_bench.extras import load
from prefcal_bench.global_random import seeded
from prefcal_env.preferences.history import History

from .peer import Peer


@final
class ReferenceGLIS(Peer):
    """GLIS as published by its authors, with the package's own settings.

    It is set up again for each proposal, like `ReferenceGLISp`. Experiments without a score are
    left out.

    Source: package `glis` 2.0.2 by Bemporad and Zhu.
    Deviation: its random generator is seeded for each proposal; it searches the unit cube, and
    integers are snapped afterwards; scores are divided by a power of 2, which changes no proposal
    and avoids overflow.

    Arguments and errors are those of `Agent`. Without the extra `peers`, MissingExtraError is raised.
    """

    by_value = True

    version: ClassVar[int] = 1
    _modules = ("glis.solvers",)

    def _planned(self, index: int) -> Float[np.ndarray, " n"] | None:
        return _design("GLIS", len(self.space), self.setup.n_init, self.setup.seed, index)

    def _proposal(self, history: History, tried: Tried) -> Float[np.ndarray, " n"] | None:
        scored, values = scores_of(history)
        if not len(scored):
            return None
        solver = _cube_solver("GLIS", cube_of(history)[scored])
        solver.initialize()
        _, exponent = np.frexp(np.abs(values).max())
        with seeded(self.setup.seed, history.answered):
            for value in np.ldexp(values, -exponent):
                z = solver.update(value)
        return np.asarray(z)


@final
class ReferenceGLISp(Peer):
    """GLISp as published by its authors, with the package's own settings.

    The package owns its state. Here its solver is set up again for each proposal from the stored
    samples and the valid answers, so nothing else has to be stored. It ignores abstentions, which
    it does not support. Its Latin hypercube has at least 2 samples.
    `n_max` experiments take n_max - 1 comparisons.

    Source: package `glis` 2.0.2 by Bemporad and Zhu.
    Deviation: its random generator is seeded for each proposal; it searches the unit cube, and
    integers are snapped afterwards.

    Arguments and errors are those of `Agent`. Without the extra `peers`, MissingExtraError is raised.
    """

    version: ClassVar[int] = 1
    _modules = ("glis.solvers",)

    def _prepare(self) -> None:
        super()._prepare()
        self._thetas: dict[History, float] = {}

    def _planned(self, index: int) -> Float[np.ndarray, " n"] | None:
        return _design("GLISp", len(self.space), max(self.setup.n_init, 2), self.setup.seed, index)

    def _proposal(self, history: History, tried: Tried) -> Float[np.ndarray, " n"] | None:
        theta = self._theta(history)
        solver = self._solver(history, RBFcalibrate=False, thetas=np.array([theta]))
        with seeded(self.setup.seed, history.answered):
            # The tie reported here is not added to its lists; it learns from them and proposes.
            return np.asarray(solver.update(0))

    def _solver(self, history: History, **options: Any) -> Any:
        """Return the package's solver in its state after running the last sample of `history`."""
        z = cube_of(history)
        solver = _cube_solver("GLISp", z, expected_max_evals=self.setup.n_max, **options)
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
        start = max(self.setup.n_init, 2)
        quarters = [round(k * (self.setup.n_max - start) / 4) for k in (0, 1, 2, 3)]
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


def _design(solver: str, n: int, count: int, seed: int, index: int) -> Float[np.ndarray, " n"] | None:
    """Return the sample with this index of the `count` first ones of a class; None after them."""
    if index >= count:
        return None
    with seeded(seed, 0):
        fresh = _made(solver, n, count)
        fresh.initialize_()
    return np.array(fresh.X[index])


def _made(solver: str, n: int, count: int, **options: Any) -> Any:
    made = getattr(load("glis.solvers", "peers"), solver)
    return made(bounds=(np.zeros(n), np.ones(n)), n_initial_random=count, display=0, **options)


def _cube_solver(solver: str, z: Float[np.ndarray, "N n"], **options: Any) -> Any:
    """Return an instance of the class `solver` whose initial samples are `z`, shape (N, n).

    The package treats all samples alike once they ran, so all of them can be initial samples:
    after the answer about the last one, it proposes the next.
    """
    count, n = z.shape
    fresh = _made(solver, n, count, **options)

    def samples() -> Float[np.ndarray, "N n"]:
        fresh.X = list(z)
        fresh.KnownFeasible = [1.0] * count
        scaled: Float[np.ndarray, "N n"] = 2 * z - 1
        return scaled

    fresh.initialize_ = samples
    return fresh
