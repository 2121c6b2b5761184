"""Who compares in the benchmark: sure of himself, or erring now and then."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.calibrators import Lexicographic
from prefcal_env.calibrators.noise import generator_of_pair
from prefcal_env.errors import SettingsError
from prefcal_env.experiment import Experiment
from prefcal_env.preference import Preference


@dataclass(frozen=True, slots=True)
class Outcome:
    """What there is to know of a θ that was tried.

    Args:
        theta: Physical, shape (n,).
        cost: Latent, lower is better; None where the problem has none.
        experiment: None for a test function.
        kpis: What an agent may learn from beside the answers; None for a test function.
    """

    theta: Float[np.ndarray, " n"]
    cost: float | None
    experiment: Experiment | None = None
    kpis: Mapping[str, float] | None = None


class Judge(Protocol):
    """A calibrator of outcomes: as in eq. pref_fun, -1 if the challenger is better."""

    def prefer(self, challenger: Outcome, incumbent: Outcome) -> Preference:
        """Say which is better."""


@dataclass(frozen=True, slots=True)
class ByCost:
    """Prefers the lower cost, and is never wrong."""

    def prefer(self, challenger: Outcome, incumbent: Outcome) -> Preference:
        """Say which is better."""
        if challenger.cost is None or incumbent.cost is None:
            raise SettingsError("outcomes without a cost cannot be compared by it")
        return Preference(int(np.sign(challenger.cost - incumbent.cost)))


@dataclass(frozen=True, slots=True)
class ByCriteria:
    """Compares the experiments by criteria in order of importance, and is never wrong."""

    criteria: Lexicographic

    def prefer(self, challenger: Outcome, incumbent: Outcome) -> Preference:
        """Say which is better."""
        if challenger.experiment is None or incumbent.experiment is None:
            raise SettingsError("outcomes without an experiment cannot be compared by criteria")
        return self.criteria.prefer(challenger.experiment, incumbent.experiment)


@dataclass(frozen=True, slots=True)
class Flipping:
    """Says the opposite of `judge` in that share of the answers.

    Which ones depends on `seed` and the two θ alone: asked again, or the other way round, he
    makes the same mistake. A tie stays one.

    Raises:
        SettingsError: a share outside [0, 1].
    """

    judge: Judge
    share: float
    seed: int

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise SettingsError(f"share must be in [0, 1], got {self.share!r}")

    def prefer(self, challenger: Outcome, incumbent: Outcome) -> Preference:
        """Say which is better, or not."""
        verdict = self.judge.prefer(challenger, incumbent)
        dice = generator_of_pair(self.seed, challenger.theta, incumbent.theta)
        return Preference(-verdict) if dice.random() < self.share else verdict
