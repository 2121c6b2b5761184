"""Score candidates: low values of the surrogate are good, and so is distance from all samples."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.models.gaussian_process import PreferenceGP
from prefcal_agents.models.rbf import Surrogate, squared_distances

_NEAREST = 1e-75  # squares to 1e-150: the sum of inverses stays finite on a sample


def exploration(d: Float[np.ndarray, "m N"]) -> Float[np.ndarray, " m"]:
    """Return the IDW distance z from all samples: 0 on a sample, below π/2 elsewhere, in radians.

    Source: eq. IDW-distance with w = 1/d².
    Deviation: none.

    Args:
        d: Squared distances (eq. distance) of m points to the N samples, shape (m, N).
    """
    with np.errstate(over="ignore"):
        weights = np.sum(1 / np.maximum(d, _NEAREST) ** 2, axis=1)
    return np.asarray(np.where(np.any(d == 0, axis=1), 0.0, np.arctan(1 / weights)))


def exploration_and_gradient(
    z: Float[np.ndarray, " n"], samples: Float[np.ndarray, "N n"]
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Return z of eq. IDW-distance and its gradient at one point of the cube; 0 on a sample."""
    away = z - samples
    d = np.sum(away * away, axis=1)
    nearest = d.min()
    if nearest < _NEAREST:
        return 0.0, np.zeros(len(z))
    # With s = Σ d⁻² and arctan(1/s): the slope is -1/(1 + s²) times ∂s = Σ -2 d⁻³ · 2 away.
    # Relative to the nearest sample, because d⁻³ and s² could overflow.
    ratio = nearest / d
    s = np.sum(ratio**2)
    slope = (4 * nearest / (nearest**4 + s**2)) * (ratio**3 @ away)
    return float(np.arctan(nearest**2 / s)), np.asarray(slope)


Learned = Surrogate | PreferenceGP


@dataclass(frozen=True, slots=True)
class Acquisition:
    """The acquisition a(θ) of eq. acquisition on the unit cube.

    Args:
        surrogate: Surrogate Ĵ.
        delta: Weight δ of exploration, 0 or more.
        spread: Range ΔĴ; 1 if the surrogate is flat (nothing is known, or only ties).
        tried: Samples that exploration stays away from, unit cube, shape (N, n).
    """

    surrogate: Learned
    delta: float
    spread: float
    tried: Float[np.ndarray, "N n"]

    @classmethod
    def of(
        cls, surrogate: Learned, delta: float, tried: Float[np.ndarray, "N n"] | None = None
    ) -> "Acquisition":
        """Normalize `surrogate` by its range; `tried` may have more samples than it was fit to."""
        spread = surrogate.spread
        tried = surrogate.centers if tried is None else tried
        return cls(surrogate, delta, spread if spread > 0 else 1.0, tried)

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return a at the rows of `z`, shape (m, n), as shape (m,).

        Source: eq. acquisition.
        Deviation: none.
        """
        value = self.surrogate(z) / self.spread
        if not self.delta:
            return value
        d = squared_distances(z, self.tried)
        return np.asarray(value - self.delta * exploration(d))

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return a and ∂a/∂z at one point of the cube, shape (n,)."""
        value, slope = self.surrogate.value_and_gradient(z)
        value, slope = value / self.spread, slope / self.spread
        if not self.delta:
            return value, slope
        away, of_away = exploration_and_gradient(z, self.tried)
        return value - self.delta * away, np.asarray(slope - self.delta * of_away)
