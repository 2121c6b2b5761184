"""What GLISp has learned after a ledger: surrogates, and what cross-validation chose for them."""

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace
from prefcal_env.qp import Backend

from .cross_validation import AnyShape, Validation, choose_epsilon, nearest, rescale_knob
from .fitting import Constraints, Learning, fit, margins
from .kernel import KernelShape
from .ledger import Ledger
from .outcomes import Judgement, Outcomes
from .schedule import turn_of
from .settings import EVERY_STEP, GLISpSettings
from .softness import FEWEST, WINDOW, advantage, contradictory
from .surrogate import Composite, Shape, Surrogate

_MANY = 100  # comparisons; beyond, cross-validation tries fewer shapes: at 400 it took 0.5 s


@dataclass(frozen=True, slots=True)
class Learner:
    """Learns from ledgers; a function of each ledger alone.

    Args:
        space: The knobs.
        settings: Of GLISp.
        n_init: Samples of the start, during which nothing is validated.
        seed: Of the cross-validations.
        backend: QP solver.
        shapes: The shape of φ of either surrogate after a ledger; a cache, which changes no
            result.
        evidence: Ledger to how much better a soft fit foretells answers; a cache too.
    """

    space: KnobSpace
    settings: GLISpSettings
    n_init: int
    seed: int
    backend: Backend
    shapes: dict[tuple[Ledger, bool], Shape | KernelShape] = field(
        default_factory=dict, repr=False, compare=False
    )
    evidence: dict[Ledger, int] = field(default_factory=dict, repr=False, compare=False)

    def learned(
        self,
        ledger: Ledger,
        noise: Float[np.ndarray, " M"] | None = None,
        *,
        kernel: bool = False,
        validated: Ledger | None = None,
    ) -> Surrogate | Composite:
        """Ĵ that the M answers in `ledger` teach, with a factor `noise`, (M,), on their margins.

        With `kernel` it is the one of least kernel norm. Shape and softness are those that
        cross-validation finds for the ledger `validated`, an earlier one where time is short.

        Deviation: KPIs that explain the answers are part of it, as far as cross-validation finds
        that they help to foretell answers; scale 0 among the `outcome_scales` is without them.
        """
        validated = ledger if validated is None else validated
        preferences, learning = ledger.preferences(), self._learning(validated)
        shape = self.kernel_shape(validated) if kernel else self.shape(validated)
        margin = margins(preferences, self.settings.margin_power, self.settings.strong_margins)
        margin = margin if noise is None else margin * noise
        features = shape.features(preferences.samples)
        constraints = Constraints.of(preferences, features, margin)
        outcomes = Outcomes.none()
        if any(self.settings.outcome_scales):
            outcomes = Outcomes.of(ledger).foreseeable()
        scale = self._outcome_scale(ledger, shape, outcomes)
        if scale == 0:
            v = fit(constraints, learning, self.backend)
            return Surrogate(preferences.samples, shape.weights(features, v), shape)
        constraints = constraints.with_outcomes(preferences, scale * outcomes.columns)
        v = fit(constraints, learning, self.backend)
        n = len(features)
        judgement = Judgement(outcomes, scale * np.maximum(v[n:], 0.0))
        beta = shape.weights(features, v[:n])
        return Composite(Surrogate(preferences.samples, beta, shape), judgement)

    def _learning(self, ledger: Ledger) -> Learning:
        """How β is learned: softly where the answers contradict each other (see `advantage`)."""
        learning, soften = self.settings.learning, self.settings.soften
        if soften == 1.0 or learning.lam == 0:
            return learning
        first = max(ledger.answered - WINDOW, self.n_init - 1) + 1
        found = [self._advantage(ledger.until(k)) for k in range(first, ledger.answered + 1)]
        return replace(learning, lam=soften * learning.lam) if contradictory(found) else learning

    def _advantage(self, ledger: Ledger) -> int:
        if ledger not in self.evidence:
            preferences, settings = ledger.preferences(), self.settings
            self.evidence[ledger] = 0 if len(preferences) < FEWEST else advantage(
                preferences, self.shape(ledger), settings.learning, settings.soften, self.backend,
                settings.folds, (self.seed, ledger.answered),
            )  # fmt: skip
        return self.evidence[ledger]

    def _outcome_scale(
        self, ledger: Ledger, shape: Shape | KernelShape, outcomes: Outcomes
    ) -> float:
        """By how much KPIs count beside θ, so that left-out answers are foretold best."""
        scales, preferences = self.settings.outcome_scales, ledger.preferences()
        if not len(outcomes) or len(preferences) < self.settings.folds:
            return 0.0
        validation = self._validation(ledger)
        scores = [
            validation.reproduced(shape, scale * outcomes.columns if scale else None)
            for scale in scales
        ]
        winners = [s for s, score in zip(scales, scores, strict=True) if score == max(scores)]
        return winners[len(winners) // 2]

    def _validation(self, ledger: Ledger) -> Validation:
        settings = self.settings
        rng = np.random.default_rng([self.seed, ledger.answered, 1])
        return Validation.deal(
            ledger.preferences(), settings.learning, self.backend, settings.folds, rng
        )

    def shape(self, ledger: Ledger) -> Shape:
        """Shape of φ in use after `ledger`: each cross-validation starts from the one before."""
        return self._chain(ledger, self.settings.shape(len(self.space)), kernel=False)

    def kernel_shape(self, ledger: Ledger) -> KernelShape:
        """The same for the surrogate of least kernel norm."""
        return self._chain(ledger, self.settings.kernel_shape(len(self.space)), kernel=True)

    def _chain(self, ledger: Ledger, shape: AnyShape, *, kernel: bool) -> AnyShape:
        missing: list[Ledger] = []
        for count in range(ledger.answered, 0, -1):
            if not self._validates(count, kernel):
                continue
            prefix = ledger.until(count)
            known = self.shapes.get((prefix, kernel))
            if known is not None:
                shape = cast(AnyShape, known)
                break
            missing.append(prefix)
        for prefix in reversed(missing):
            shape = self._validated(prefix, shape)
            self.shapes[prefix, kernel] = shape
        return shape

    def _validated(self, ledger: Ledger, shape: AnyShape) -> AnyShape:
        """The better shape that cross-validation finds next to `shape`."""
        settings, preferences = self.settings, ledger.preferences()
        if len(preferences) < settings.folds:
            return shape
        validation = self._validation(ledger)
        candidates, many = settings.candidates(shape), len(preferences) > _MANY
        if many:  # ε hardly moves any more, and every try takes tens of milliseconds
            candidates = nearest(candidates, shape.epsilon, 1)
        shape, score = choose_epsilon(validation, shape, candidates)
        if settings.rescale and len(self.space) > 1:
            # Each surrogate has two turns of four in a row: so it comes round to every knob.
            turn = ledger.answered // 2 if settings.kernel else ledger.answered
            knob = turn % len(self.space)
            around_epsilon = nearest(candidates, shape.epsilon, 0 if many else 1)
            shape = rescale_knob(validation, shape, score, around_epsilon, knob=knob)
        return shape

    def _validates(self, answered: int, kernel: bool) -> bool:
        """Whether the shape is chosen anew: at every step means where its surrogate has a turn."""
        at = self.settings.validate_at
        if at != EVERY_STEP:
            return answered in at
        return answered >= self.n_init and self._is_kernel(answered) == kernel

    def _is_kernel(self, index: int) -> bool:
        after_start, kernel = index - self.n_init, self.settings.kernel
        return turn_of(after_start, kernel=kernel, perturb_every=0, local=False).kernel
