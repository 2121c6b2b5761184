"""Compute the acquisition of GLIS, which rewards low, uncertain and distant points."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.models.interpolant import Interpolant
from prefcal_agents.models.rbf import squared_distances

from .inverse_distance import Slopes, Weights, distance, variance

_FLAT = 1e-12  # a deviation below this has no slope worth following


@dataclass(frozen=True, slots=True)
class ValueAcquisition:
    """The acquisition a = f - α s - δ z over the box scaled to [-1, 1]; f interpolates scores.

    Source: Bemporad 2020, equation 10, divided by its ΔF: the range of the scores is 1 here.

    Args:
        interpolant: Interpolant f, with centers in [-1, 1].
        values: Scores of the N samples, shape (N,), between 0 and 1; f goes through them.
        alpha: Weight α of the IDW deviation s, 0 or more.
        delta: Weight δ of the IDW distance z, 0 or more.
    """

    interpolant: Interpolant
    values: Float[np.ndarray, " N"]
    alpha: float
    delta: float

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return a at the rows of `z`, shape (m, n), unit cube, as shape (m,)."""
        x = 2 * z - 1
        weights = Weights.of(squared_distances(x, self.interpolant.centers))
        f = self.interpolant(x)
        s = np.sqrt(variance(weights, self.values, f))
        return np.asarray(f - self.alpha * s - self.delta * distance(weights))

    def value_and_gradient(
        self, z: Float[np.ndarray, " n"]
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return value and gradient at one point of the cube, shape (n,)."""
        return float(self(z[None])[0]), self.gradient(z)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return ∂a/∂z at one point of the cube, shape (n,)."""
        x = 2 * z - 1
        slope = self.interpolant.gradient(x)
        slopes = Slopes.at(x, self.interpolant.centers)
        if slopes is None:
            return np.asarray(2 * slope)
        f = self.interpolant(x[None])
        s = float(np.sqrt(variance(slopes.weights, self.values, f)[0]))
        of_s = slopes.variance(self.values, f[0], slope) / (2 * s) if s > _FLAT else 0.0
        return np.asarray(2 * (slope - self.alpha * of_s - self.delta * slopes.distance()))
