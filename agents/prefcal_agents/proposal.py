"""GLISp's next sample, as a function of seed, settings and ledger alone."""

from dataclasses import dataclass, field
from typing import cast

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace
from prefcal_env.qp import Backend

from .acquisition import Acquisition
from .cross_validation import AnyShape, Validation, choose_epsilon, nearest, rescale_knob
from .cube import Tried, integer_mask, latin_hypercube, snap_all
from .fitting import Constraints, fit, margins
from .kernel import KernelShape
from .ledger import Ledger
from .minimise import Box, Domain
from .outcomes import Judgement, Outcomes
from .schedule import Turn, turn_of
from .settings import EVERY_STEP, MINIMISERS, GLISpSettings
from .surrogate import Composite, Shape, Surrogate
from .threads import one_thread
from .trust_region import around, half_width

_MANY = 100  # comparisons; beyond, cross-validation tries fewer shapes: at 400 it took 0.5 s


@dataclass(frozen=True, slots=True)
class Strategy:
    """Everything that stays the same during a study, and a cache of shapes.

    Args:
        space: The knobs.
        settings: Of GLISp.
        n_init: Samples of the Latin hypercube.
        seed: Of all randomness; sample i draws from `(seed, i)`.
        backend: QP solver.
        shapes: The shape of φ of either surrogate after a ledger; a cache, which changes no
            result.
    """

    space: KnobSpace
    settings: GLISpSettings
    n_init: int
    seed: int
    backend: Backend
    shapes: dict[tuple[Ledger, bool], Shape | KernelShape] = field(
        default_factory=dict, repr=False, compare=False
    )

    def propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        """Cube point of the sample that follows `ledger`, shape (n,).

        Source: eq. xNp1.
        Deviation: those of `turn_of`. A perturbed proposal minimises a surrogate whose margins
        are drawn at random (each times an exponential variate), without the exploration term.
        Equal margins are arbitrary: others reproduce the same answers with another minimum,
        and one fixed choice keeps returning to the same place when it is wrong.
        """
        with one_thread():
            return self._proposed(ledger)

    def _proposed(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        index = ledger.answered
        rng = np.random.default_rng([self.seed, index])
        tried = Tried(self.space, ledger)
        if index < self.n_init:
            return tried.fresh(latin_hypercube(self.space, self.n_init, self.seed)[index], rng)
        turn, noise, delta = self._turn(index), None, self.settings.delta
        if turn.perturbed:
            noise, delta = rng.exponential(size=len(ledger.preferences())), 0.0
        acquisition = Acquisition.of(self.learned(ledger, noise, kernel=turn.kernel), delta)
        minimise = MINIMISERS[self.settings.minimiser]
        # A trust region of integers may hold nothing new.
        for domain in self._domains(ledger, turn):
            for z in minimise(acquisition, domain, rng):
                if z not in tried:
                    return np.asarray(z)
        return tried.fresh(domain.start, rng)

    def _domains(self, ledger: Ledger, turn: Turn) -> list[Domain]:
        """Where to search, and where to search next if nothing new is found there."""
        start = np.array(ledger.samples[ledger.incumbent or 0])
        boxes: list[Box | None] = [None]
        if turn.local:
            half = half_width(ledger, self.settings.trust_region, self._is_local)
            boxes.insert(0, around(start, half))
        mask = integer_mask(self.space)
        return [Domain(mask, lambda z: snap_all(self.space, z), start, box) for box in boxes]

    def _turn(self, index: int) -> Turn:
        settings = self.settings
        return turn_of(
            index - self.n_init,
            kernel=settings.kernel,
            perturb_every=settings.perturb_every,
            local=settings.trust_region > 0,
        )

    def _is_local(self, index: int) -> bool:
        return index >= self.n_init and self._turn(index).local

    def learned(
        self,
        ledger: Ledger,
        noise: Float[np.ndarray, " M"] | None = None,
        *,
        kernel: bool = False,
    ) -> Surrogate | Composite:
        """Ĵ that the M answers in `ledger` teach, with a factor `noise`, (M,), on their margins.

        With `kernel` it is the one of least kernel norm.

        Deviation: KPIs that explain the answers are part of it, as far as cross-validation finds
        that they help to foretell answers; scale 0 among the `outcome_scales` is without them.
        """
        preferences = ledger.preferences()
        shape = self.kernel_shape(ledger) if kernel else self.shape(ledger)
        margin = margins(preferences, self.settings.margin_power)
        margin = margin if noise is None else margin * noise
        features = shape.features(preferences.samples)
        constraints = Constraints.of(preferences, features, margin)
        outcomes = Outcomes.of(ledger)
        scale = self._outcome_scale(ledger, shape, outcomes)
        if scale == 0:
            v = fit(constraints, self.settings.learning, self.backend)
            return Surrogate(preferences.samples, shape.weights(features, v), shape)
        constraints = constraints.with_outcomes(preferences, scale * outcomes.columns)
        v = fit(constraints, self.settings.learning, self.backend)
        n = len(features)
        judgement = Judgement(outcomes, scale * np.maximum(v[n:], 0.0))
        beta = shape.weights(features, v[:n])
        return Composite(Surrogate(preferences.samples, beta, shape), judgement)

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
        return answered >= self.n_init and self._turn(answered).kernel == kernel
