"""A calibrator that judges by a cost function, with or without errors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Preference

from .noise import Noise, generator_of_pair


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
        if isinstance(self.tie_band, bool) or not 0 <= self.tie_band < np.inf:
            raise SettingsError(f"tie_band must be 0 or more, got {self.tie_band!r}")
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise SettingsError(
                f"noise must be Thurstone, BradleyTerry or None, got {self.noise!r}"
            )
        if isinstance(self.seed, bool) or not (
            isinstance(self.seed, (int, np.integer)) and self.seed >= 0
        ):
            raise SettingsError(f"seed must be an integer of 0 or more, got {self.seed!r}")

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
