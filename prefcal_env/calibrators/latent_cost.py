"""Calibrators that judge by a cost, and their errors: noise, or a share of wrong answers."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import integer, number
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Calibrator, Preference


@runtime_checkable
class Noise(Protocol):
    """A symmetric distribution of errors in comparing two costs."""

    def draw(self, generator: np.random.Generator) -> float:
        """Return one error of a difference of costs, in the unit of the cost."""


@dataclass(frozen=True, slots=True)
class Thurstone:
    """Normal noise of standard deviation `sigma` on each perceived cost (case V).

    The error of a difference is normal with standard deviation √2 `sigma`.

    Raises:
        SettingsError: If `sigma` is not positive and finite.
    """

    sigma: float

    def __post_init__(self) -> None:
        number("sigma", self.sigma, strict=True)

    def draw(self, generator: np.random.Generator) -> float:
        """Return one error of a difference of costs, in the unit of the cost."""
        return float(np.sqrt(2) * self.sigma * generator.standard_normal())


@dataclass(frozen=True, slots=True)
class BradleyTerry:
    """Logistic noise: a beats b with probability 1/(1 + exp((cost(a) - cost(b))/scale)).

    The error of a difference is logistic.

    Raises:
        SettingsError: If `scale` is not positive and finite.
    """

    scale: float

    def __post_init__(self) -> None:
        number("scale", self.scale, strict=True)

    def draw(self, generator: np.random.Generator) -> float:
        """Return one error of a difference of costs, in the unit of the cost."""
        return float(generator.logistic(scale=self.scale))


@dataclass(frozen=True, slots=True)
class Flipping:
    """A calibrator that flips another calibrator's answer in a share of the cases.

    Which answers are wrong depends only on `seed` and the two θ: if the question is repeated or
    asked the other way round, the mistake is the same. Ties and abstentions never change.

    Args:
        calibrator: Calibrator whose answers are flipped; what it compares must have a `theta`.
        share: Share of wrong answers, from 0 to 1.
        seed: Seed that decides which answers are wrong, 0 or more.

    Raises:
        SettingsError: If the share is outside [0, 1].
    """

    calibrator: Calibrator[Any]
    share: float
    seed: int

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise SettingsError(f"share must be in [0, 1], got {self.share!r}")

    def prefer(self, challenger: Any, incumbent: Any) -> Answer | Preference | int | None:
        """Return the calibrator's answer, or its opposite."""
        verdict = self.calibrator.prefer(challenger, incumbent)
        dice = generator_of_pair(self.seed, challenger.theta, incumbent.theta)
        if verdict is None or dice.random() >= self.share:
            return verdict
        if not isinstance(verdict, Answer):
            return Preference(-verdict)
        preference = verdict.preference
        return replace(verdict, preference=None if preference is None else Preference(-preference))


def generator_of_pair(
    seed: int, a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]
) -> np.random.Generator:
    """Return a generator that depends on `seed` and the two θ, shape (n,), but not their order."""
    pair = sorted((tuple(a + 0.0), tuple(b + 0.0)))  # + 0.0 turns -0.0 into 0.0
    key = np.array(pair).view(np.uint32).ravel()
    return np.random.default_rng([int(seed), *key.tolist()])


@dataclass(frozen=True)
class LatentCost:
    """A `Calibrator` that prefers the experiment with the lower perceived `cost`.

    Perceived costs within `tie_band` of each other are a tie, and so are equal θ. The error of a
    comparison depends only on `seed` and the two θ: the answer is the same if the question is
    repeated or asked the other way round.

    Source: eq. pref_fun, with f hidden.

    Args:
        cost: Function that returns the cost of an experiment; lower is better, may be infinite.
        tie_band: Smallest noticeable difference of costs, 0 or more.
        noise: Distribution of errors; None for no errors.
        seed: Seed of the noise, 0 or more.

    Raises:
        SettingsError: If an option is not valid; in `prefer`, if a cost is NaN or no number.
    """

    cost: Callable[[Experiment], float]
    tie_band: float = 0.0
    noise: Noise | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not callable(self.cost):
            raise SettingsError(f"cost must be a function of an experiment, got {self.cost!r}")
        number("tie_band", self.tie_band)
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise SettingsError(f"noise must be Thurstone, BradleyTerry or None, got {self.noise!r}")
        integer("seed", self.seed, low=0)

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> Preference:
        """Return which one is better, as in eq. pref_fun."""
        a, b = self._cost(challenger), self._cost(incumbent)
        difference = 0.0 if a == b else a - b  # two infinite costs are equal
        if self.noise is not None:
            difference += self._error(challenger.theta, incumbent.theta)
        if abs(difference) <= self.tie_band:
            return Preference.TIE
        return Preference.CHALLENGER if difference < 0 else Preference.INCUMBENT

    def _cost(self, experiment: Experiment) -> float:
        found: Any = self.cost(experiment)
        try:
            cost = float(found)
        except (TypeError, ValueError):
            cost = np.nan
        if np.isnan(cost):
            raise SettingsError(f"cost must be a number, got {found!r} at θ = {experiment.theta}")
        return cost

    def _error(self, a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
        """Return the error of cost(a) - cost(b): antisymmetric in a and b, so 0 for equal θ."""
        assert self.noise is not None
        if np.array_equal(a, b):
            return 0.0
        error = self.noise.draw(generator_of_pair(self.seed, a, b))
        return error if tuple(a) < tuple(b) else -error
