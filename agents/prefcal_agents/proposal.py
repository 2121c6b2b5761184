"""GLISp's next sample, as a function of seed, settings and ledger alone."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs import KnobSpace
from prefcal_env.qp import Backend

from .acquisition import Acquisition
from .cross_validation import choose_epsilon
from .cube import Tried, integer_mask, latin_hypercube, snap_all
from .ledger import Ledger, Preferences
from .minimise import Domain
from .rbf import squared_distances
from .settings import EVERY_STEP, MINIMISERS, GLISpSettings
from .surrogate import Surrogate, basis, fit


@dataclass(frozen=True, slots=True)
class Strategy:
    """Everything that stays the same during a study.

    Args:
        space: The knobs.
        settings: Of GLISp.
        n_init: Samples of the Latin hypercube.
        seed: Of all randomness; sample i draws from `(seed, i)`.
        backend: QP solver.
    """

    space: KnobSpace
    settings: GLISpSettings
    n_init: int
    seed: int
    backend: Backend

    def propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        """Cube point of the sample that follows `ledger`, shape (n,)."""
        index = ledger.answered
        rng = np.random.default_rng([self.seed, index])
        tried = Tried(self.space, ledger)
        if index < self.n_init:
            return tried.fresh(latin_hypercube(self.space, self.n_init, self.seed)[index], rng)
        preferences = ledger.preferences()
        epsilon = self.epsilon(ledger)
        perturbed = self._perturbs(index)
        noise = rng.exponential(size=len(preferences)) if perturbed else None
        surrogate = self.surrogate(preferences, epsilon, noise)
        delta = 0.0 if perturbed else self.settings.delta
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
        epsilon: float,
        noise: Float[np.ndarray, " M"] | None = None,
    ) -> Surrogate:
        """Ĵ that `preferences` teach, with shape parameter `epsilon`."""
        d = squared_distances(preferences.samples, preferences.samples)
        phi = basis(d, epsilon, self.settings.rbf)
        beta = fit(preferences, phi, self.settings.hyper, self.backend, noise)
        return Surrogate(preferences.samples, beta, epsilon, self.settings.rbf)

    def epsilon(self, ledger: Ledger) -> float:
        """ε in use once `ledger` is answered: from the last cross-validation, if any."""
        at = self._validated_at(ledger.answered)
        if at is None:
            return self.settings.epsilon
        known = ledger.until(at).preferences()
        if len(known) < self.settings.folds:
            return self.settings.epsilon
        return choose_epsilon(
            known,
            [self.settings.epsilon * factor for factor in self.settings.epsilons],
            self.settings.hyper,
            self.backend,
            folds=self.settings.folds,
            rng=np.random.default_rng([self.seed, at, 1]),
        )

    def _validated_at(self, answered: int) -> int | None:
        """Number of answers that the ε in use was chosen with."""
        if self.settings.validate_at == EVERY_STEP:
            return answered if answered >= self.n_init else None
        assert not isinstance(self.settings.validate_at, str)
        return max((k for k in self.settings.validate_at if k <= answered), default=None)

    def _perturbs(self, index: int) -> bool:
        every = self.settings.perturb_every
        return every > 0 and (index - self.n_init) % every == 0
