"""GLISp: preference-based optimisation with radial basis functions and IDW exploration."""

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace
from prefcal_env.qp import make_backend

from .checks import integer
from .cube import encode_all
from .doubt import Doubts
from .learned_index import LearnedIndex
from .learner import Learner
from .proposal import Strategy
from .settings import GLISpSettings
from .start import Start
from .state import AgentState
from .threads import one_thread
from .turn_taking import PreferenceBased
from .turns import Turns

VERSION = 7
"""Of the algorithm: raised when the same answers would lead to another next sample."""


@final
class GLISp(PreferenceBased):
    """Active preference learning: asks for the experiment that promises or teaches most.

    The first `n_init` samples are a Latin hypercube. Then Ĵ is learned from all preferences
    (eq. QP-pref), ε chosen by cross-validation, and an acquisition minimised (eq. xNp1).

    Source: section III of the paper.
    Deviation: those of `GLISpSettings`. `GLISp.paper` learns without them, and keeps three, all
    measured in docs/deviations.md: the box (see `KnobSpace`), the plain Latin hypercube of the
    start, and a particle swarm without a pattern search.

    Args:
        space: The knobs.
        n_init: Samples of the start, 1 or more.
        n_max: Experiments in all, which take n_max - 1 comparisons.
        seed: Of all randomness, 0 or more.
        settings: Everything else.
        start: Physical θ to begin with, the present tuning say, shape (n,), or several: they
            take the place of the first of the `n_init` samples.
        delta: δ of eq. acquisition, in place of the one in `settings`; that is minimised then.

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
        settings: GLISpSettings | None = None,
        delta: float | None = None,
        start: Start | None = None,
    ) -> None:
        settings = GLISpSettings() if settings is None else settings
        if not isinstance(settings, GLISpSettings):
            raise SettingsError(f"settings must be GLISpSettings, got {settings!r}")
        integer("seed", seed, low=0)
        if delta is not None:
            settings = replace(settings, delta=delta, expected_improvement=False)
        self._settings = settings
        self._seed = int(seed)
        # A backend of its own: twins may think ahead at the same time.
        doubts = Doubts(space, self._settings.rbf, n_init, self._settings.error_rate)
        backend = make_backend("piqp")
        self._learner = Learner(space, self._settings, n_init, self._seed, backend, doubts)
        self._strategy = Strategy(space, self._settings, n_init, self._seed, self._learner)
        self._turns = Turns(
            space,
            n_init,
            n_max,
            self._strategy.propose,
            further=self._strategy.further,
            last=self._strategy.last,
            start=start,
        )

    @classmethod
    def paper(
        cls,
        space: KnobSpace,
        *,
        n_init: int = 10,
        n_max: int = 50,
        seed: int = 0,
        start: Start | None = None,
    ) -> "GLISp":
        """The algorithm and settings of the paper, section IV.

        Deviation: the box is [0, 1]^n, and the start a plain Latin hypercube; see `GLISp`.
        """
        settings = GLISpSettings.paper()
        return cls(space, n_init=n_init, n_max=n_max, seed=seed, settings=settings, start=start)

    @classmethod
    def restore(cls, space: KnobSpace, state: AgentState) -> "GLISp":
        """Carry on from `state`, with the identical next query.

        Raises:
            SettingsError: it is the state of another agent, or does not fit the space.
        """
        state.check("GLISp")
        agent = cls(
            space,
            n_init=state.n_init,
            n_max=state.n_max,
            seed=state.seed,
            settings=GLISpSettings.of(dict(state.settings)),
        )
        agent._turns.load(state.ledger, state.start)
        return agent

    @property
    def state(self) -> AgentState:
        """Everything that has to be saved; the sample of the open query is among it."""
        self._turns.settle()
        return self._snapshot()

    def _snapshot(self) -> AgentState:
        return self._turns.state("GLISp", VERSION, self._seed, self._settings.pairs())

    def copy(self) -> "GLISp":
        """Return an independent twin, for running ahead on each likely answer."""
        return self._twin(self._snapshot())

    def with_questions(self, most: int) -> "GLISp":
        """A twin that asks at most so many comparisons for each experiment from now on, 1 or more.

        Nothing that was answered is lost. An open query about a new experiment stays; an open
        further one goes where it would be one too many.

        Raises:
            SettingsError: `most` is no integer from 1 on.
        """
        settings = replace(self._settings, questions_per_experiment=most)
        return self._twin(replace(self._snapshot(), settings=settings.pairs()))

    def _twin(self, state: AgentState) -> "GLISp":
        twin = self.restore(self.space, state)
        twin._learner.shapes.update(self._learner.shapes)
        twin._learner.scales.update(self._learner.scales)
        twin._learner.doubts.take_over(self._learner.doubts)
        return twin

    @property
    def settings(self) -> GLISpSettings:
        """All settings."""
        return self._settings

    @property
    def epsilon(self) -> float:
        """ε of eq. rbf in use, after the answers so far."""
        return self._learner.shape(self._turns.ledger).epsilon

    @property
    def index(self) -> LearnedIndex | None:
        """The weighted sum of KPIs that explains the answers so far best, to look at or export.

        None where no KPIs came with the answers, or nothing is learned from them.
        """
        with one_thread():
            return LearnedIndex.of(self._turns.ledger, self._seed, self._learner.backend)

    def surrogate(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Ĵ/ΔĴ at physical `thetas`, shape (m, n), less its smallest value on the samples.

        So the best sample has 0 and the worst 1: shape (m,), without unit, for plotting. All
        zeros while nothing is known.

        Raises:
            KnobError: `thetas` has another shape or leaves the box.
        """
        z = encode_all(self.space, thetas)
        if len(self._turns.ledger.preferences()) == 0:
            return np.zeros(len(z))
        with one_thread():
            learned = self._learner.learned(self._turns.ledger)
        on_samples = learned(learned.centres)
        spread = float(np.ptp(on_samples))
        return np.asarray((learned(z) - on_samples.min()) / (spread if spread > 0 else 1.0))
