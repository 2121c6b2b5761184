"""What GLISp has learned after a ledger: surrogates, and what cross-validation chose for them."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_env.champions import contradictory
from prefcal_env.knobs import KnobSpace
from prefcal_env.qp import Backend

from .appeal import SURE, to_appeal
from .belief import Belief
from .cross_validation import FOLDS, Validation, choose_epsilon, nearest, rescale_knob
from .doubt import Doubt, Doubts, rows_of
from .fitting import Constraints, fit, margins
from .ledger import Ledger, Preferences
from .memory import MOST, Memory
from .outcomes import Judgement, Outcomes
from .schedule import MANY, SELDOM, is_process_turn, process_turns
from .settings import EVERY_STEP, GLISpSettings
from .surrogate import Composite, Shape, Surrogate

_SHAPE_AT, _SCALE_AT = 5, 7  # of these ten; doubts come at 0, so no proposal has to wait for all


@dataclass(frozen=True, slots=True)
class Learner:
    """Learns from ledgers; a function of each ledger alone.

    Args:
        space: The knobs.
        settings: Of GLISp.
        n_init: Samples of the start, during which nothing is validated.
        seed: Of the cross-validations.
        backend: QP solver.
        doubts: Whether answers contradict each other.
        shapes: The shape of φ after a ledger; a cache, which changes no result.
        beliefs: The latest belief, and how much KPIs count in it; a cache too.
        scales: By how much KPIs count after a ledger, with a shape of φ; a cache too.
        foreseen: The KPIs of the latest ledger; a cache too.
        memories: What is remembered of the latest ledgers; a cache too.
    """

    space: KnobSpace
    settings: GLISpSettings
    n_init: int
    seed: int
    backend: Backend
    doubts: Doubts
    shapes: dict[Ledger, Shape] = field(default_factory=dict, repr=False, compare=False)
    beliefs: dict[tuple[Ledger, Ledger], tuple[Belief, float]] = field(
        default_factory=dict, repr=False, compare=False
    )
    scales: dict[tuple[Ledger, Shape], float] = field(
        default_factory=dict, repr=False, compare=False
    )
    foreseen: dict[Ledger, Outcomes] = field(default_factory=dict, repr=False, compare=False)
    memories: dict[Ledger, Memory] = field(default_factory=dict, repr=False, compare=False)

    def remembered(self, ledger: Ledger) -> Memory:
        """Return the part of `ledger` that is learned from."""
        if ledger not in self.memories:
            if len(self.memories) >= SELDOM:
                self.memories.clear()
            self.memories[ledger] = Memory.of(ledger)
        return self.memories[ledger]

    def preferences(self, ledger: Ledger) -> Preferences:
        """Return the answers in `ledger` that are learned from; see `Memory`."""
        return self.remembered(ledger).ledger.preferences()

    def learned(self, ledger: Ledger, *, validated: Ledger | None = None) -> Surrogate | Composite:
        """Return Ĵ, trained on the answers in `ledger`.

        Shape and noise test are those of the ledger `validated`, an earlier one if time is short.

        Deviation: KPIs that explain the answers are part of Ĵ if cross-validation finds that they
        help to predict answers; scale 0 among the `outcome_scales` leaves them out. If answers
        contradict each other, Ĵ need not reproduce all of them; see `Belief`.
        """
        validated = ledger if validated is None else validated
        doubt = self.doubt(validated)
        if doubt is not None and self.is_noisy(validated):
            return self._believed(ledger, doubt.shape, validated)
        preferences, learning = self.preferences(ledger), self.settings.learning
        shape = self.shape(validated)
        margin = margins(preferences, self.settings.margin_power)
        features = shape.basis(preferences.samples, preferences.samples)
        constraints = Constraints.of(preferences, features, margin)
        outcomes = self._outcomes(ledger)
        scale = self._outcome_scale(ledger, shape, outcomes)
        if scale:
            constraints = constraints.with_outcomes(preferences, scale * outcomes.columns)
        v = fit(constraints, learning, self.backend)
        return _assembled(preferences, shape, features, v, outcomes, scale)

    def _believed(self, ledger: Ledger, shape: Shape, validated: Ledger) -> Surrogate | Composite:
        """Return Ĵ where answers may be wrong."""
        preferences, outcomes = self.preferences(ledger), self._outcomes(ledger)
        belief, scale = self._belief(ledger, shape, validated)
        features = shape.basis(preferences.samples, preferences.samples)
        return _assembled(preferences, shape, features, belief.mean, outcomes, scale)

    def _belief(self, ledger: Ledger, shape: Shape, validated: Ledger) -> tuple[Belief, float]:
        """What is believed of β, and by how much KPIs count in it."""
        if (ledger, validated) not in self.beliefs:
            outcomes = self._outcomes(ledger)
            scale = self._outcome_scale(ledger, self.shape(validated), outcomes)
            columns = scale * outcomes.columns if scale else None
            constraints = rows_of(self.preferences(ledger), shape, columns)
            self.beliefs.clear()  # each is as large as Φ
            belief = Belief.of(constraints, self.settings.error_rate)
            self.beliefs[ledger, validated] = belief, scale
        return self.beliefs[ledger, validated]

    def appeal(
        self, ledger: Ledger, *, validated: Ledger, only_better: bool = False
    ) -> tuple[int, int] | None:
        """Two samples to compare where answers are doubted; None where they are not, or settled.

        Doubt and shape are those of `validated`. With `only_better` mistakes must be likely, and
        the rival believed better than the best sample.
        """
        doubt = self.doubt(validated)
        if doubt is None or not doubt.justified:
            return None
        belief, scale = self._belief(ledger, doubt.shape, validated)
        memory = self.remembered(ledger)
        z = memory.ledger.cube()
        known = doubt.shape.basis(z, z)
        if scale:
            known = np.hstack([known, scale * self._outcomes(ledger).columns])
        features = np.zeros((ledger.answered, known.shape[1]))
        values = np.full(ledger.answered, np.inf)
        features[memory.kept] = known
        values[memory.kept] = self._believed(ledger, doubt.shape, validated)(z)
        return to_appeal(ledger, values, features, belief, sure=0.0 if only_better else SURE)

    def is_noisy(self, ledger: Ledger) -> bool:
        """Return whether answers are taken for a fallible person's.

        Two things must come together: some answers contradict each other, and all of them are
        predicted better with mistakes than without. Suspicion alone only leads to a question
        (see `appeal`): a cost that jumps looks like mistakes, too.
        """
        doubt = self.doubt(ledger)
        return doubt is not None and doubt.justified and contradictory(ledger.verdicts())

    def doubt(self, ledger: Ledger) -> Doubt | None:
        """What is doubted after `ledger`; None while there are too few answers."""
        return self.doubts.after(ledger, self._columns)

    def _columns(self, ledger: Ledger) -> Float[np.ndarray, "N p"] | None:
        """KPIs that explain the answers, times how much they count; None without any."""
        outcomes = self._outcomes(ledger)
        scale = self._outcome_scale(ledger, self.shape(ledger), outcomes) if len(outcomes) else 0
        return scale * outcomes.columns if scale else None

    def _outcomes(self, ledger: Ledger) -> Outcomes:
        if not any(self.settings.outcome_scales):
            return Outcomes.none()
        if ledger not in self.foreseen:
            self.foreseen.clear()  # what was foretold before is not asked for again
            self.foreseen[ledger] = Outcomes.of(self.remembered(ledger).ledger).foreseeable()
        return self.foreseen[ledger]

    def _outcome_scale(self, ledger: Ledger, shape: Shape, outcomes: Outcomes) -> float:
        """By how much KPIs count beside θ, so that left-out answers are foretold best."""
        if not len(outcomes) or len(ledger.preferences()) < FOLDS:
            return 0.0
        answered = ledger.answered
        if answered > MANY + SELDOM:
            ledger = ledger.until(answered - (answered - _SCALE_AT) % SELDOM)
            shape = self.shape(ledger)
        if (ledger, shape) not in self.scales:
            if ledger.answered < answered:
                outcomes = self._outcomes(ledger)
            self.scales[ledger, shape] = self._best_scale(ledger, shape, outcomes)
        return self.scales[ledger, shape]

    def _best_scale(self, ledger: Ledger, shape: Shape, outcomes: Outcomes) -> float:
        scales = self.settings.outcome_scales
        validation = self._validation(ledger)
        scores = [
            validation.reproduced(shape, scale * outcomes.columns if scale else None)
            for scale in scales
        ]
        winners = [s for s, score in zip(scales, scores, strict=True) if score == max(scores)]
        return winners[len(winners) // 2]

    def _validation(self, ledger: Ledger) -> Validation:
        rng = np.random.default_rng([self.seed, ledger.answered, 1])
        learning = self.settings.learning
        return Validation.deal(self.preferences(ledger), learning, self.backend, rng)

    def shape(self, ledger: Ledger) -> Shape:
        """Shape of φ in use after `ledger`: each cross-validation starts from the one before."""
        missing: list[Ledger] = []
        shape = self.settings.shape(len(self.space))
        last = MOST if self.settings.validate_at == EVERY_STEP else ledger.answered
        for count in range(min(ledger.answered, last), 0, -1):
            prefix = ledger.until(count)
            if not self._validates(prefix):
                continue
            if prefix in self.shapes:
                shape = self.shapes[prefix]
                break
            missing.append(prefix)
        for prefix in reversed(missing):
            shape = self._validated(prefix, shape)
            self.shapes[prefix] = shape
        return shape

    def _validated(self, ledger: Ledger, shape: Shape) -> Shape:
        """The better shape that cross-validation finds next to `shape`."""
        settings, preferences = self.settings, ledger.preferences()
        if len(preferences) < FOLDS:
            return shape
        validation = self._validation(ledger)
        candidates, many = settings.candidates, len(preferences) > MANY
        if many:  # ε hardly moves any more, and every try takes tens of milliseconds
            candidates = nearest(candidates, shape.epsilon, 1)
        shape, score = choose_epsilon(validation, shape, candidates)
        if settings.rescale and len(self.space) > 1:
            knob = self._validations(ledger) % len(self.space)
            around_epsilon = nearest(candidates, shape.epsilon, 0 if many else 1)
            shape = rescale_knob(validation, shape, score, around_epsilon, knob=knob)
        return shape

    def _validates(self, ledger: Ledger) -> bool:
        """Whether the shape is chosen anew: at every step means where the surrogate has a turn.

        Beyond `MOST` experiments it stays: the answers that it was chosen by are forgotten.
        """
        at, answered = self.settings.validate_at, ledger.answered
        if at != EVERY_STEP:
            return answered in at
        if answered < self.n_init:
            return False
        if answered > MANY:
            return answered <= MOST and answered % SELDOM == _SHAPE_AT
        return not (self._takes_turns(ledger) and is_process_turn(answered, self.n_init))

    def _takes_turns(self, ledger: Ledger) -> bool:
        """Whether every second proposal is the process's, as far as can be told beforehand."""
        with_kpis = any(self.settings.outcome_scales) and any(ledger.outcomes())
        return self.settings.process and not with_kpis

    def _validations(self, ledger: Ledger) -> int:
        """About how many there have been: at each experiment, but at the process's turns."""
        if ledger.answered > MANY:
            return ledger.answered // SELDOM
        without = process_turns(ledger.answered, self.n_init) if self._takes_turns(ledger) else 0
        return ledger.answered - without


def _assembled(
    preferences: Preferences,
    shape: Shape,
    features: Float[np.ndarray, "N N"],
    v: Float[np.ndarray, " P"],
    outcomes: Outcomes,
    scale: float,
) -> Surrogate | Composite:
    """Ĵ of the coefficients `v`: of the features, and of the KPIs unless their scale is 0."""
    n = len(features)
    surrogate = Surrogate(preferences.samples, v[:n], shape)
    if scale == 0:
        return surrogate
    return Composite(surrogate, Judgement(outcomes, scale * np.maximum(v[n:], 0.0)))
