"""GLISp's next sample, as a function of seed, settings and ledger alone."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace
from prefcal_env.qp import Backend

from .acquisition import Acquisition
from .cross_validation import GAIN, Validation, choose_epsilon, rescale_knob
from .cube import Tried, latin_hypercube
from .fitting import Constraints, Learning, fit, margins
from .ledger import Ledger
from .marks import POOL, replaced, steered, unsafe_worry
from .outcomes import Judgement, Outcomes
from .placing import to_place
from .region import random_points, search_domain
from .settings import EVERY_STEP, MINIMISERS, GLISpSettings
from .softness import FEWEST, WINDOW, advantage, contradictory
from .surrogate import Composite, Shape, Surrogate
from .threads import one_thread


@dataclass(frozen=True, slots=True)
class Strategy:
    """Everything that stays the same during a study, and a cache of shapes.

    Args:
        space: The knobs.
        settings: Of GLISp.
        n_init: Samples of the Latin hypercube.
        seed: Of all randomness; sample i draws from `(seed, i)`.
        backend: QP solver.
        shapes: Ledger to the shape of φ after it; a cache, which changes no result.
        evidence: Ledger to how much better a soft fit foretells answers; a cache too.
    """

    space: KnobSpace
    settings: GLISpSettings
    n_init: int
    seed: int
    backend: Backend
    shapes: dict[Ledger, Shape] = field(default_factory=dict, repr=False, compare=False)
    evidence: dict[Ledger, int] = field(default_factory=dict, repr=False, compare=False)

    def propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        """Cube point of the sample that follows `ledger`, shape (n,).

        Source: eq. xNp1.
        Deviation: every `perturb_every`-th proposal minimises a surrogate whose margins are
        drawn at random (each times an exponential variate), without the exploration term.
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
            return tried.fresh(self._planned(ledger, rng), rng)
        noise, delta = None, self.settings.delta
        if self._perturbs(index):
            noise, delta = rng.exponential(size=len(ledger.preferences())), 0.0
        surrogate = self.learned(ledger, noise)
        domain = search_domain(self.space, ledger)
        objective = steered(Acquisition.of(surrogate, delta), ledger, self.settings)
        minimise = MINIMISERS[self.settings.minimiser]
        for z in minimise(objective, domain, rng):
            if tried.may_run(z):
                return np.asarray(z)
        return tried.fresh(domain.start, rng)

    def further(self, ledger: Ledger) -> tuple[int, int] | None:
        """Two known samples to compare before the next is proposed: challenger and incumbent."""
        if len(ledger.latest) >= self.settings.questions_per_experiment or ledger.answered < 3:
            return None
        with one_thread():
            # Without a cross-validation of its own: the next question follows each answer.
            known = self.learned(ledger, validated=ledger.until(ledger.answered - 1))
            return to_place(ledger, known(ledger.cube()))

    def _planned(self, ledger: Ledger, rng: np.random.Generator) -> Float[np.ndarray, " n"]:
        """Of the start, unless marks say that it is likely unsafe there."""
        plan, index = latin_hypercube(self.space, self.n_init, self.seed), ledger.answered
        worry = unsafe_worry(ledger, self.settings)
        if worry is None:
            return np.asarray(plan[index])
        others = np.vstack([ledger.cube(), plan[index + 1 :]])
        return replaced(plan[index], others, random_points(self.space, POOL, rng), worry)

    def learned(
        self,
        ledger: Ledger,
        noise: Float[np.ndarray, " M"] | None = None,
        validated: Ledger | None = None,
    ) -> Surrogate | Composite:
        """Ĵ that the M answers in `ledger` teach, with a factor `noise`, (M,), on their margins.

        Shape and softness are those that cross-validation finds for the ledger `validated`, an
        earlier one where time is short.

        Deviation: KPIs that explain the answers are part of it, as far as cross-validation finds
        that they help to foretell answers; scale 0 among the `outcome_scales` is without them.
        """
        validated = ledger if validated is None else validated
        preferences, shape = ledger.preferences(), self.shape(validated)
        learning = self._learning(validated)
        margin = margins(preferences, self.settings.margin_power, self.settings.strong_margins)
        margin = margin if noise is None else margin * noise
        phi = shape.basis(preferences.samples, preferences.samples)
        constraints = Constraints.of(preferences, phi, margin)
        outcomes = Outcomes.of(ledger) if any(self.settings.outcome_scales) else Outcomes.none()
        scale = self._outcome_scale(ledger, shape, outcomes)
        if scale == 0:
            beta = fit(constraints, learning, self.backend)
            return Surrogate(preferences.samples, beta, shape)
        constraints = constraints.with_outcomes(preferences, scale * outcomes.columns)
        beta = fit(constraints, learning, self.backend)
        n = len(phi)
        judgement = Judgement(outcomes, scale * np.maximum(beta[n:], 0.0))
        return Composite(Surrogate(preferences.samples, beta[:n], shape), judgement)

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

    def _outcome_scale(self, ledger: Ledger, shape: Shape, outcomes: Outcomes) -> float:
        """By how much KPIs count beside θ, so that left-out answers are foretold best."""
        scales, preferences = self.settings.outcome_scales, ledger.preferences()
        if not len(outcomes) or len(preferences) < self.settings.folds:
            return 0.0
        validation = self._validation(ledger)
        scores = [
            validation.reproduced(shape, scale * outcomes.columns if scale else None)
            for scale in scales
        ]
        if scales[0] == 0 and max(scores) < scores[0] + GAIN:
            return 0.0  # else useless KPIs cost experiments: docs/research/outcomes.md
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
        missing: list[Ledger] = []
        shape = self.settings.shape(len(self.space))
        for count in range(ledger.answered, 0, -1):
            if not self._validates(count):
                continue
            prefix = ledger.until(count)
            if prefix in self.shapes:
                shape = self.shapes[prefix]
                break
            missing.append(prefix)
        for prefix in reversed(missing):
            shape = self.shapes[prefix] = self._validated(prefix, shape)
        return shape

    def _validated(self, ledger: Ledger, shape: Shape) -> Shape:
        """The better shape that cross-validation finds next to `shape`."""
        settings, preferences = self.settings, ledger.preferences()
        if len(preferences) < settings.folds:
            return shape
        validation = self._validation(ledger)
        candidates = [settings.epsilon * factor for factor in settings.epsilons]
        shape, score = choose_epsilon(validation, shape, candidates)
        if settings.rescale and len(self.space) > 1:
            knob = ledger.answered % len(self.space)
            shape = rescale_knob(validation, shape, score, candidates, knob=knob)
        return shape

    def _validates(self, answered: int) -> bool:
        at = self.settings.validate_at
        return answered >= self.n_init if at == EVERY_STEP else answered in at

    def _perturbs(self, index: int) -> bool:
        every = self.settings.perturb_every
        return every > 0 and (index - self.n_init) % every == 0
