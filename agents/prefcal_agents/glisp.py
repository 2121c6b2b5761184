"""GLISp: preference-based optimization with radial basis functions and IDW exploration."""

from dataclasses import replace
from typing import Any, ClassVar, final

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
from .stored import Stored
from .threads import one_thread
from .turn_taking import PreferenceBased
from .turns import Turns


@final
class GLISp(Stored, PreferenceBased):
    """Learn from preferences which experiment to run next.

    The first `n_init` samples are a Latin hypercube. Then Ĵ is trained on all preferences
    (eq. QP-pref), ε is chosen by cross-validation, and an acquisition is minimized (eq. xNp1).

    Source: section III of the paper.
    Deviation: those of `GLISpSettings`. `GLISp.paper` is without them, and has three, all
    measured in docs/deviations.md: the box (see `KnobSpace`), the plain Latin hypercube of the
    start, and a multistart descent instead of a particle swarm.

    Args:
        space: The knobs.
        n_init: Number of samples of the start, 1 or more.
        n_max: Number of experiments, which take n_max - 1 comparisons.
        seed: Seed of all randomness, 0 or more.
        settings: All other settings.
        start: Physical θ to begin with, the present tuning say, shape (n,), or several: they
            take the place of the first of the `n_init` samples.
        delta: δ of eq. acquisition instead of the one in `settings`; turns expected improvement
            off, so that eq. acquisition is minimized.

    Raises:
        SettingsError: an impossible value.
        KnobError: a θ of `start` is outside the space.
    """

    version: ClassVar[int] = 8

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
        self._options = settings
        self._seed = int(seed)
        # A backend of its own: twins may think ahead at the same time.
        doubts = Doubts(space, settings.rbf, n_init, settings.error_rate)
        backend = make_backend("piqp")
        self._learner = Learner(space, settings, n_init, self._seed, backend, doubts)
        self._strategy = Strategy(space, settings, n_init, self._seed, self._learner)
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
        """Make an agent with the algorithm and settings of the paper, section IV.

        Deviation: the box is [0, 1]^n, the start a plain Latin hypercube, and eq. xNp1 is solved
        by the same multistart search as in the default, not by a particle swarm; see `GLISp`.
        """
        settings = GLISpSettings.paper()
        return cls(space, n_init=n_init, n_max=n_max, seed=seed, settings=settings, start=start)

    def _settings(self) -> dict[str, Any]:
        return dict(self._options.pairs())

    @classmethod
    def _arguments(cls, saved: dict[str, Any]) -> dict[str, Any]:
        return {"settings": GLISpSettings.of(saved)}

    def copy(self) -> "GLISp":
        """Return an independent twin that need not learn again, for running ahead on answers."""
        return self._twin(self._snapshot())

    def with_questions(self, most: int) -> "GLISp":
        """Return a twin that asks at most `most` comparisons for each experiment from now on.

        No answer is lost. An open query about a new experiment stays open; an open further one
        is dropped if it would be one too many.

        Raises:
            SettingsError: `most` is not an integer of 1 or more.
        """
        settings = replace(self._options, questions_per_experiment=most)
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
        return self._options

    @property
    def epsilon(self) -> float:
        """ε of eq. rbf in use, after the answers so far."""
        return self._learner.shape(self._turns.ledger).epsilon

    @property
    def index(self) -> LearnedIndex | None:
        """Weighted sum of KPIs that explains the answers so far best, to look at or export.

        None if no KPIs came with the answers, or nothing is learned from them.
        """
        with one_thread():
            return LearnedIndex.of(self._turns.ledger, self._seed, self._learner.backend)

    def surrogate(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return Ĵ/ΔĴ at physical `thetas`, shape (m, n), minus its smallest value on the samples.

        The best sample has 0 and the worst 1: shape (m,), without unit, for plotting. All
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
