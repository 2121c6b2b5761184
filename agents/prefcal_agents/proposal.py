"""GLISp's next sample, as a function of seed, settings and ledger alone."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace
from prefcal_env.qp import Backend

from .acquisition import Acquisition
from .cross_validation import Validation, choose_epsilon, rescale_knob
from .cube import Tried, integer_mask, latin_hypercube, snap_all
from .fitting import Constraints, fit, margins
from .ledger import Ledger, Preferences
from .minimise import Domain
from .settings import EVERY_STEP, MINIMISERS, GLISpSettings
from .surrogate import Shape, Surrogate
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
    """

    space: KnobSpace
    settings: GLISpSettings
    n_init: int
    seed: int
    backend: Backend
    shapes: dict[Ledger, Shape] = field(default_factory=dict, repr=False, compare=False)

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
            return tried.fresh(latin_hypercube(self.space, self.n_init, self.seed)[index], rng)
        preferences = ledger.preferences()
        noise, delta = None, self.settings.delta
        if self._perturbs(index):
            noise, delta = rng.exponential(size=len(preferences)), 0.0
        surrogate = self.surrogate(preferences, self.shape(ledger), noise)
        domain = Domain(
            integer_mask(self.space),
            lambda z: snap_all(self.space, z),
            np.array(ledger.samples[ledger.incumbent or 0]),
        )
        minimise = MINIMISERS[self.settings.minimiser]
        for z in minimise(Acquisition.of(surrogate, delta), domain, rng):
            if z not in tried:
                return np.asarray(z)
        return tried.fresh(domain.start, rng)

    def surrogate(
        self,
        preferences: Preferences,
        shape: Shape,
        noise: Float[np.ndarray, " M"] | None = None,
    ) -> Surrogate:
        """Ĵ that `preferences` teach, with a factor `noise`, shape (M,), on their margins."""
        margin = margins(preferences, self.settings.margin_power)
        margin = margin if noise is None else margin * noise
        phi = shape.basis(preferences.samples, preferences.samples)
        constraints = Constraints.of(preferences, phi, margin)
        beta = fit(constraints, self.settings.learning, self.backend)
        return Surrogate(preferences.samples, beta, shape)

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
        rng = np.random.default_rng([self.seed, ledger.answered, 1])
        validation = Validation.deal(
            preferences, settings.learning, self.backend, settings.folds, rng
        )
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
