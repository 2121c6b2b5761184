"""GLIS: optimisation of a known score, with radial basis functions and IDW exploration."""

from typing import final

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace

from .checks import integer
from .cube import Tried, encode_all, latin_hypercube
from .glis_settings import GLISSettings
from .interpolation import Interpolant, best_interpolant, normalised
from .ledger import Ledger
from .minimise import multistart
from .region import random_points, search_domain
from .start import Start
from .state import AgentState
from .threads import one_thread
from .turn_taking import ValueBased
from .turns import Turns
from .value_acquisition import ValueAcquisition

VERSION = 1
"""Of the algorithm: raised when the same scores would lead to another next sample."""


@final
class GLIS(ValueBased):
    """Sees the score of every experiment; the bar for those that see preferences only.

    The first `n_init` samples are a Latin hypercube. Then the scores are interpolated, and the
    acquisition of `ValueAcquisition` is minimised.

    Source: Bemporad 2020 (see `inverse_distance`); section IV-A of the paper compares with it.
    Deviation: those of `GLISSettings`, and a multistart descent in place of particle swarm.

    Args:
        space: The knobs.
        n_init: Samples of the start, 1 or more.
        n_max: Experiments in all.
        seed: Of all randomness, 0 or more.
        settings: Everything else.
        start: Physical θ to begin with, the present tuning say, shape (n,), or several: they
            take the place of the first of the `n_init` samples.

    Raises:
        SettingsError: an impossible value.
        KnobError: a θ of `start` is outside the space.
    """

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
        integer("seed", seed, low=0)
        self._seed, self._settings = int(seed), settings
        self._turns = Turns(space, n_init, n_max, self._propose, by_value=True, start=start)

    def _propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        index, space = ledger.answered, self.space
        rng = np.random.default_rng([self._seed, index])
        tried = Tried(space, ledger)
        if index < self.n_init:
            return tried.fresh(latin_hypercube(space, self.n_init, self._seed)[index], rng)
        if not len(ledger.scores()[0]):
            return tried.fresh(random_points(space, 1, rng)[0], rng)
        domain = search_domain(space, ledger)
        with one_thread():
            for z in multistart(self._acquisition(ledger), domain, rng):
                if tried.may_run(z):
                    return np.asarray(z)
        return tried.fresh(domain.start, rng)

    def _acquisition(self, ledger: Ledger) -> ValueAcquisition:
        interpolant, values = self._interpolant(ledger)
        return ValueAcquisition(interpolant, values, self._settings.alpha, self._settings.delta)

    def _interpolant(self, ledger: Ledger) -> tuple[Interpolant, Float[np.ndarray, " K"]]:
        scored, values = ledger.scores()
        values = normalised(values, self._settings.ceiling)
        x = 2 * ledger.cube()[scored] - 1
        settings = self._settings
        return best_interpolant(x, values, settings.epsilons, settings.rbf), values

    @classmethod
    def restore(cls, space: KnobSpace, state: AgentState) -> "GLIS":
        """Carry on from `state`, with the identical next query.

        Raises:
            SettingsError: it is the state of another agent, or does not fit the space.
        """
        state.check("GLIS")
        agent = cls(
            space,
            n_init=state.n_init,
            n_max=state.n_max,
            seed=state.seed,
            settings=GLISSettings.of(dict(state.settings)),
        )
        agent._turns.load(state.ledger, state.start)
        return agent

    @property
    def state(self) -> AgentState:
        """Everything that has to be saved; the sample of the open query is among it."""
        self._turns.settle()
        return self._snapshot()

    def _snapshot(self) -> AgentState:
        return self._turns.state("GLIS", VERSION, self._seed, self._settings.pairs())

    def copy(self) -> "GLIS":
        """Return an independent twin."""
        return self.restore(self.space, self._snapshot())

    @property
    def settings(self) -> GLISSettings:
        """All settings."""
        return self._settings

    def surrogate(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """The interpolated score at physical `thetas`, shape (m, n); shape (m,), without unit.

        The best sample has 0 and the worst 1 (all above the ceiling of `settings` count as the
        worst). All zeros while nothing is known.

        Raises:
            KnobError: `thetas` has another shape or leaves the box.
        """
        z = encode_all(self.space, thetas)
        if not len(self._turns.ledger.scores()[0]):
            return np.zeros(len(z))
        return self._interpolant(self._turns.ledger)[0](2 * z - 1)
