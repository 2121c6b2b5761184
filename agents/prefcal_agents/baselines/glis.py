"""GLIS: optimization of a known score, with radial basis functions and IDW exploration."""

from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.acquisition.value_acquisition import ValueAcquisition
from prefcal_agents.history.lessons import cube_of, scores_of
from prefcal_agents.models.interpolant import Interpolant, best_interpolant, normalized
from prefcal_agents.optimize.search import Tried, new_minimum
from prefcal_agents.protocol.agent import ValueBased
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.space.feasible import random_points
from prefcal_agents.space.start import Start
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .glis_settings import GLISSettings


@final
class GLIS(ValueBased):
    """Optimize a score that is known after every experiment; a baseline for preferences.

    The first `n_init` samples are a Latin hypercube. Then the scores are interpolated, and the
    acquisition of `ValueAcquisition` is minimized.

    Source: Bemporad 2020 (see `inverse_distance`); section IV-A of the paper compares with it.
    Deviation: see `GLISSettings`; in addition, a multistart descent instead of a particle swarm.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the start, 1 or more.
        n_max: Number of experiments.
        seed: Seed of all randomness, 0 or more.
        settings: All other settings.
        start: Physical θ to start from, such as the current tuning, shape (n,), or several. They
            replace the first of the `n_init` samples.

    Raises:
        SettingsError: If a value is not valid.
        KnobError: If a θ of `start` is outside the space.
    """

    version: ClassVar[int] = 1

    def __init__(
        self,
        space: KnobSpace,
        *,
        n_init: int = 10,
        n_max: int = 50,
        seed: int = 0,
        settings: GLISSettings | None = None,
        start: Start | None = None,
    ) -> None:
        settings = GLISSettings() if settings is None else settings
        if not isinstance(settings, GLISSettings):
            raise SettingsError(f"settings must be GLISSettings, got {settings!r}")
        self._options = settings
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed, start=start)

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        index, space = history.answered, self.space
        rng = np.random.default_rng([self._seed, index])
        tried = Tried(space, history)
        if index < self.n_init:
            return tried.fresh(latin_hypercube(space, self.n_init, self._seed)[index], rng)
        if not len(scores_of(history)[0]):
            return tried.fresh(random_points(space, 1, rng)[0], rng)
        return new_minimum(self._acquisition(history), space, history, rng)

    def _acquisition(self, history: History) -> ValueAcquisition:
        interpolant, values = self._interpolant(history)
        return ValueAcquisition(interpolant, values, self._options.alpha, self._options.delta)

    def _interpolant(self, history: History) -> tuple[Interpolant, Float[np.ndarray, " K"]]:
        scored, values = scores_of(history)
        values = normalized(values, self._options.ceiling)
        x = 2 * cube_of(history)[scored] - 1
        options = self._options
        return best_interpolant(x, values, options.epsilons, options.rbf), values

    def _settings(self) -> dict[str, Any]:
        return dict(self._options.pairs())

    @classmethod
    def _arguments(cls, saved: dict[str, Any]) -> dict[str, Any]:
        return {"settings": GLISSettings.of(saved)}

    @property
    def settings(self) -> GLISSettings:
        """Return all settings."""
        return self._options

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
