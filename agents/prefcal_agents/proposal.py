"""GLISp's next sample, as a function of seed, settings and ledger alone."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_env.champions import contradictory
from prefcal_env.knobs import KnobSpace

from .acquisition import Acquisition
from .cube import Tried, latin_hypercube
from .doubt import ALMOST_SURE
from .improvement import ExpectedImprovement
from .learner import Learner
from .ledger import Ledger
from .marks import POOL, replaced, steered, unsafe_worry
from .minimise import Domain, Objective, multistart
from .placing import to_place
from .preference_process import PreferenceProcess
from .region import random_points, search_domain
from .rematch import final
from .schedule import is_process_turn
from .settings import GLISpSettings
from .surrogate import Composite
from .threads import one_thread

_APART = 10
"""Experiments between two questions on a suspicion."""


@dataclass(frozen=True, slots=True)
class Strategy:
    """Everything that stays the same during a study.

    Args:
        space: The knobs.
        settings: Of GLISp.
        n_init: Samples of the Latin hypercube.
        seed: Of all randomness; sample i draws from `(seed, i)`.
        learner: What is learned from a ledger.
        decoded: Samples to their θ; a cache, which changes no result.
    """

    space: KnobSpace
    settings: GLISpSettings
    n_init: int
    seed: int
    learner: Learner
    decoded: dict[tuple[float, ...], Float[np.ndarray, " n"]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def propose(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        """Return the cube point of the sample that follows `ledger`, shape (n,).

        The first `n_init` samples are a Latin hypercube; each later one minimizes an acquisition.

        Source: eq. xNp1.
        Deviation: those of `_acquisition` and `is_process_turn`; marks add to the acquisition,
        see `steered`.
        """
        with one_thread():
            return self._proposed(ledger)

    def last(self, ledger: Ledger) -> tuple[int, int] | None:
        """Two known samples to compare after the last experiment; see `final`.

        Without an error rate every answer is taken for true, as in the paper.
        """
        return final(ledger) if self.settings.error_rate else None

    def further(self, ledger: Ledger) -> tuple[int, int] | None:
        """Two known samples to compare before the next is proposed: challenger and incumbent.

        Where answers are doubted an appeal, once that is settled a bisection; see `to_appeal` and
        `to_place`.
        """
        asked, most = len(ledger.latest), self.settings.questions_per_experiment
        if asked >= max(most, 2) or ledger.answered < 3:
            return None
        # While nothing contradicts itself, a question more than agreed on comes seldom.
        lately = any(_lately(ledger, c.after) for c in ledger.further)
        if asked >= most and lately and not contradictory(ledger.verdicts()):
            return None
        with one_thread():
            # Without a cross-validation of its own: the next question follows each answer.
            earlier = ledger.until(ledger.answered - 1)
            pair = self.learner.appeal(ledger, validated=earlier, only_better=asked >= most)
            if pair is not None or asked >= most:
                return pair
            return to_place(ledger, self.learner.learned(ledger, validated=earlier)(ledger.cube()))

    def _proposed(self, ledger: Ledger) -> Float[np.ndarray, " n"]:
        index = ledger.answered
        rng = np.random.default_rng([self.seed, index])
        tried = Tried(self.space, ledger, self.decoded)
        if index < self.n_init:
            return tried.fresh(self._planned(ledger, rng), rng)
        objective = steered(self._acquisition(ledger), ledger, self.settings)
        domain = self._domain(ledger)
        for z in multistart(objective, domain, rng):
            if tried.may_run(z):
                return np.asarray(z)
        return tried.fresh(domain.start, rng)

    def _acquisition(self, ledger: Ledger) -> Objective:
        """Return the function that the next sample minimizes.

        Deviation: expected improvement where KPIs count; its Gaussian process has a length for
        each knob and knows where it is unsure. Without KPIs, where it is no better than
        eq. acquisition (docs/research/improvement.md), the mean of a Gaussian process trained on
        comparisons takes every second turn.
        """
        settings, preferences = self.settings, self.learner.preferences(ledger)
        told, doubted = bool(preferences.b.any()), self.learner.is_noisy(ledger)
        improves = settings.expected_improvement and told and not doubted
        with_kpis = any(settings.outcome_scales) and any(ledger.outcomes())
        surrogate = self.learner.learned(ledger) if with_kpis else None
        if isinstance(surrogate, Composite) and improves:
            return ExpectedImprovement.of(surrogate)
        # The process knows no KPIs, so it has no turns where they count.
        takes_turns = settings.process and told and not isinstance(surrogate, Composite)
        if takes_turns and is_process_turn(ledger.answered, self.n_init):
            # One comparison for each sample cannot contradict the others, further ones can.
            trusted = ALMOST_SURE if ledger.further else 0.0
            error_rate = settings.error_rate if doubted else trusted
            learned = PreferenceProcess.of(preferences, error_rate)
            return Acquisition.of(learned, 0.0)
        return Acquisition.of(self.learner.learned(ledger), settings.delta, ledger.cube())

    def _planned(self, ledger: Ledger, rng: np.random.Generator) -> Float[np.ndarray, " n"]:
        """Of the start, unless marks say that it is likely unsafe there."""
        plan, index = latin_hypercube(self.space, self.n_init, self.seed), ledger.answered
        worry = unsafe_worry(ledger, self.settings)
        if worry is None:
            return np.asarray(plan[index])
        others = np.vstack([ledger.cube(), plan[index + 1 :]])
        return replaced(plan[index], others, random_points(self.space, POOL, rng), worry)

    def _domain(self, ledger: Ledger) -> Domain:
        return search_domain(self.space, ledger, best=self._best(ledger))

    def _best(self, ledger: Ledger) -> int:
        return ledger.incumbent or 0


def _lately(ledger: Ledger, after: int | None) -> bool:
    return after is not None and after > ledger.answered - _APART
