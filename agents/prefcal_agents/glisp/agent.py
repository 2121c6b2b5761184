"""GLISp: preference-based optimization with radial basis functions and IDW exploration."""

from dataclasses import replace
from typing import ClassVar, Self, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import Preferences, judged, kpis_of
from prefcal_agents.history.stages import Remembered
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_agents.protocol.agent import Agent, Pair, one_thread, rematch
from prefcal_agents.space.start import Start
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .foresight import FROM, Foresight, lost_since
from .questions import final_question, follow_up
from .selection import ModelSelection, train
from .settings import GLISpSettings
from .strategy import propose, propose_start

_STREAM = 4
"""Stream of random numbers."""


@final
class GLISp(Agent):
    """Learn from preferences which experiment to run next.

    The first `n_init` samples are a Latin hypercube. Then Ĵ is trained on all preferences
    (eq. QP-pref), ε is chosen by cross-validation, and an acquisition is minimized (eq. xNp1).

    Source: section III of the paper.
    Deviation: see `GLISpSettings`. Those of `GLISp.paper` are all in
    docs/deviations.md, with what they change: the box (see `KnobSpace`), the plain Latin hypercube
    of the start, the candidates of ε, a multistart descent instead of a particle swarm, and round
    numbers for each knob.

    Arguments and errors are those of `Agent`: n_max experiments take n_max - 1 comparisons, and
    `settings` are `GLISpSettings`. With `delta`, it is δ of eq. acquisition instead of the one in
    `settings`, and KPIs are off, so that eq. acquisition is minimized.
    """

    version: ClassVar[int] = 12
    options = GLISpSettings

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
        if delta is not None:
            settings = replace(settings or GLISpSettings(), delta=delta, kpis=False)
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed, start=start, settings=settings)

    def _prepare(self) -> None:
        self._models = ModelSelection(self.setup)
        self._foresights = Remembered(self._foresight)

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point: of the start, or a minimum of an acquisition (eq. xNp1)."""
        if history.answered < self.setup.n_init:
            return propose_start(self.setup, history)
        return propose(self.setup, self._models.fit(history))

    def question(self, history: History) -> Pair | None:
        """Return two samples to compare: the unbeaten ones, or those about which answers may err."""
        pair = rematch(history)
        if pair is not None:
            return pair
        if history.answered < self._most(history):
            return follow_up(history, self._models, self.settings)
        # With error rate 0 every answer counts as right, as in the paper.
        return final_question(history) if self.settings.error_rate else None

    @classmethod
    def paper(
        cls, space: KnobSpace, *, n_init: int = 10, n_max: int = 50, seed: int = 0, start: Start | None = None
    ) -> "GLISp":
        """Create an agent with the algorithm and settings of the paper, section IV.

        Deviation: the box is [0, 1]^n, the start a plain Latin hypercube, and eq. xNp1 is solved
        by the same multistart search as in the default, not by a particle swarm; see `GLISp`.
        """
        settings = GLISpSettings.paper()
        return cls(space, n_init=n_init, n_max=n_max, seed=seed, settings=settings, start=start)

    def with_questions(self, most: int) -> Self:
        """Return a copy that asks at most `most` comparisons for each experiment from now on.

        No answer is lost. An open query about a new experiment stays open; an open follow-up
        query is dropped if it exceeds the limit.

        Raises:
            SettingsError: If `most` is not an integer of 1 or more.
        """
        twin = self.copy()
        settings = replace(self.settings, questions_per_experiment=most)
        twin.setup = replace(self.setup, settings=settings)
        twin._forget()
        return twin

    @property
    def settings(self) -> GLISpSettings:
        """Return all settings."""
        settings: GLISpSettings = self.setup.settings
        return settings

    @property
    def epsilon(self) -> float:
        """Return the ε of eq. rbf in use after the answers so far."""
        with one_thread():
            return self._models.after(self.history).shape.epsilon

    @property
    def index(self) -> LearnedCost | None:
        """Return the weighted sum of KPIs that best explains the answers, to inspect or export.

        None if the answers came without KPIs, or nothing can be learned from the KPIs.
        """
        with one_thread():
            return LearnedCost.of(judged(self.history), self.setup.seed)

    @property
    def foresight(self) -> Foresight | None:
        """Return what the next experiment can bring: the open one or, at the end, one more.

        None before the fifth answer, while two known experiments are compared, and without KPIs.
        """
        return self._foresights(self.history)

    def _foresight(self, history: History) -> Foresight | None:
        past, best = history.until(history.answered), history.incumbent
        if best is None or len(past.lessons()) < FROM or not (self.settings.kpis and any(kpis_of(past))):
            return None
        tried_all = self._most(history) < self.setup.n_max
        if history.pending is None and (tried_all or not self.is_over(history)):
            return None
        with one_thread():
            fit = self._models.kpi_fit(past)
            if fit is None:
                return Foresight(None, lost_since(past))
            new = history.pending or self._next(history)
            rng = np.random.default_rng([self.setup.seed, history.answered, _STREAM])
            costs = fit.costs(np.array([new.z]), rng)  # in each draw; that of the new one comes last
            better = costs[:, -1] < costs[:, fit.row(history.samples[best].theta)] - 1.0
        return Foresight(float(better.mean()), lost_since(past))

    @property
    def foresees(self) -> bool:
        """Return whether `foresight` takes milliseconds only: nothing has to be learned for it."""
        proposed = self.history.pending is not None or self._next.get(self.history) is not None
        return proposed and self._models.knows(self.history.until(self.history.answered))

    def surrogate(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return how good physical `thetas` are expected to be, shape (m, n), for plotting.

        The best sample has 0 and the worst 1: shape (m,), without unit. It is Ĵ/ΔĴ or, if KPIs
        explain the answers, the expected rank. The values are all 0 while nothing is known.

        Raises:
            KnobError: If `thetas` has another shape or leaves the box.
        """
        z = self.space.encode_all(thetas)
        if len(Preferences.of(self.history)) == 0:
            return np.zeros(len(z))
        with one_thread():
            fit = self._models.fit(self.history)
            if fit.kpis is None:
                learned = train(fit.data, fit.selection, self.settings)
                values, on_samples = learned(z), learned(learned.centers)
            else:
                values, on_samples = (fit.kpis.beaten_by(x, self.setup.seed) for x in (z, fit.kpis.bank.z))
        spread = float(np.ptp(on_samples))
        return np.asarray((values - on_samples.min()) / (spread if spread > 0 else 1.0))
