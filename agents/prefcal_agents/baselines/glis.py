"""GLIS: optimization of a known score, with radial basis functions and IDW exploration."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.acquisition.value_acquisition import ValueAcquisition
from prefcal_agents.history.lessons import cube_of, scores_of
from prefcal_agents.models.interpolant import POSITIVE_DEFINITE, Interpolant, best_interpolant, normalized
from prefcal_agents.optimize.search import Tried, new_minimum
from prefcal_agents.protocol.agent import Agent
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.space.feasible import random_points
from prefcal_agents.support.checks import Settings, choice, number
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.history import History


@dataclass(frozen=True, slots=True, kw_only=True)
class GLISSettings(Settings):
    """Configure how GLIS chooses the next experiment.

    Source: Bemporad 2020, sections 3 and 4.
    Deviation: α and δ are smaller than 0.8 and 0.5, which waste experiments far from the best
    (median of 6 seeds after 50 experiments: hartman6 0.08 against 0.20, camel 2e-5 against 6e-5,
    branin 3e-4 against 2e-3). ε is chosen at every step by leave-one-out errors, not fixed.
    Scores far above the median are capped (`ceiling`): an interrupted run costs a thousand times
    as much as a good one, and an interpolant through both cannot tell good ones apart
    (CSTR, median of 8 seeds: 0.695 with a ceiling of 2, 0.718 without).

    Args:
        alpha: Weight α of the IDW deviation, 0 or more; larger explores more.
        delta: Weight δ of the distance from all samples, 0 or more; larger explores more.
        rbf: Name of φ, one of `POSITIVE_DEFINITE`.
        epsilons: Values of ε to choose from, above 0, for the box scaled to [-1, 1].
        ceiling: A score counts as at most this many times (median - best) above the median.

    Raises:
        SettingsError: If a value is not valid.
    """

    alpha: float = 0.4
    delta: float = 0.2
    rbf: str = "inverse_quadratic"
    epsilons: tuple[float, ...] = (0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2)
    ceiling: float = 2.0

    def __post_init__(self) -> None:
        number("alpha", self.alpha)
        number("delta", self.delta)
        choice("rbf", self.rbf, POSITIVE_DEFINITE)
        number("ceiling", self.ceiling, strict=True)
        if not isinstance(self.epsilons, tuple) or not self.epsilons:
            raise SettingsError(f"epsilons must be a tuple of numbers, got {self.epsilons!r}")
        for epsilon in self.epsilons:
            number("each of epsilons", epsilon, strict=True)


@final
class GLIS(Agent):
    """Optimize a score that is known after every experiment; a baseline for preferences.

    The first `n_init` samples are a Latin hypercube. Then the scores are interpolated, and the
    acquisition of `ValueAcquisition` is minimized.

    Source: Bemporad 2020 (see `value_acquisition`); section IV-A of the paper compares with it.
    Deviation: see `GLISSettings`; in addition, a multistart descent instead of a particle swarm.

    Arguments and errors are those of `Agent`; `settings` are `GLISSettings`.
    """

    version: ClassVar[int] = 1
    options = GLISSettings
    by_value = True

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point: of the start, or a minimum of the acquisition."""
        index, space, settings = history.answered, self.space, self.settings
        rng = np.random.default_rng([self.setup.seed, index])
        tried = Tried(space, history)
        if index < self.setup.n_init:
            return tried.fresh(latin_hypercube(space, self.setup.n_init, self.setup.seed)[index], rng)
        if not len(scores_of(history)[0]):
            return tried.fresh(random_points(space, 1, rng)[0], rng)
        interpolant, values = self._interpolant(history)
        acquisition = ValueAcquisition(interpolant, values, settings.alpha, settings.delta)
        return new_minimum(acquisition, space, history, rng)

    def _interpolant(self, history: History) -> tuple[Interpolant, Float[np.ndarray, " K"]]:
        scored, values = scores_of(history)
        values = normalized(values, self.settings.ceiling)
        x = 2 * cube_of(history)[scored] - 1
        return best_interpolant(x, values, self.settings.epsilons, self.settings.rbf), values

    @property
    def settings(self) -> GLISSettings:
        """Return all settings."""
        settings: GLISSettings = self.setup.settings
        return settings

    def surrogate(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the interpolated score at physical `thetas`, shape (m, n): shape (m,), no unit.

        The best sample has 0 and the worst 1 (scores above the ceiling of `settings` count as the
        worst). The values are all 0 while nothing is known.

        Raises:
            KnobError: If `thetas` has another shape or leaves the box.
        """
        z = self.space.encode_all(thetas)
        if not len(scores_of(self.history)[0]):
            return np.zeros(len(z))
        return self._interpolant(self.history)[0](2 * z - 1)
