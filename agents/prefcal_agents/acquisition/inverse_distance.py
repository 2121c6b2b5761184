"""Compute inverse distance weighting: uncertainty of an interpolant, and distance from samples.

Source: A. Bemporad, "Global optimization via inverse distance weighting and radial basis
functions", Computational Optimization and Applications 77 (2020), equations 7 to 9.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.models.rbf import squared_distances

_ON_SAMPLE = 1e-30  # squared distance below which a point counts as a sample


@dataclass(frozen=True, slots=True)
class Weights:
    """The weights w_i = exp(-d_i)/d_i of N samples at m points, with squared distances d.

    Args:
        share: Shares v_i = w_i / Σ w_j, shape (m, N); rows sum to 1.
        largest: Weight w of the nearest sample, shape (m,); infinite on a sample.
        total: Sum Σ w_j / largest, shape (m,), 1 or more.
    """

    share: Float[np.ndarray, "m N"]
    largest: Float[np.ndarray, " m"]
    total: Float[np.ndarray, " m"]

    @classmethod
    def of(cls, d: Float[np.ndarray, "m N"]) -> "Weights":
        """Return the weights for squared distances `d`, shape (m, N)."""
        nearest = d.min(axis=1, keepdims=True)
        safe = np.maximum(d, _ON_SAMPLE)
        # Relative to the nearest sample, whose own weight may overflow.
        relative = np.exp(nearest - safe) * (np.maximum(nearest, _ON_SAMPLE) / safe)
        total = relative.sum(axis=1)
        with np.errstate(divide="ignore"):
            largest = np.exp(-nearest[:, 0]) / np.where(nearest <= _ON_SAMPLE, 0.0, nearest)[:, 0]
        return cls(relative / total[:, None], largest, total)


def variance(
    weights: Weights, values: Float[np.ndarray, " N"], predicted: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Return the IDW variance s², the weighted mean of (f_i - predicted)², shape (m,).

    It is 0 on a sample.
    """
    return np.asarray(np.sum(weights.share * (values - predicted[:, None]) ** 2, axis=1))


def distance(weights: Weights) -> Float[np.ndarray, " m"]:
    """Return the IDW distance z = 2/π arctan(1 / Σ w_i), in [0, 1), shape (m,); 0 on a sample."""
    return np.asarray(2 / np.pi * np.arctan(1 / (weights.largest * weights.total)))


@dataclass(frozen=True, slots=True)
class Slopes:
    """Weights at one point that is not a sample, and the gradients of their logarithms.

    Args:
        weights: Weights at the point, m = 1.
        log_slope: Gradients ∂ log w_i / ∂z, shape (N, n).
    """

    weights: Weights
    log_slope: Float[np.ndarray, "N n"]

    @classmethod
    def at(cls, z: Float[np.ndarray, " n"], samples: Float[np.ndarray, "N n"]) -> "Slopes | None":
        """Return the slopes at `z`, shape (n,); None on a sample, where there is no slope."""
        d = squared_distances(z[None], samples)
        if d.min() <= _ON_SAMPLE:
            return None
        log_slope = -2 * (1 + 1 / d[0])[:, None] * (z - samples)
        return cls(Weights.of(d), log_slope)

    def variance(
        self,
        values: Float[np.ndarray, " N"],
        predicted: float,
        slope: Float[np.ndarray, " n"],
    ) -> Float[np.ndarray, " n"]:
        """Return ∂s²/∂z where the interpolant is `predicted` with slope `slope`, shape (n,)."""
        v, error = self.weights.share[0], values - predicted
        of_shares = v[:, None] * (self.log_slope - v @ self.log_slope)
        return np.asarray(error**2 @ of_shares - 2 * (v @ error) * slope)

    def distance(self) -> Float[np.ndarray, " n"]:
        """Return the gradient of the IDW distance, shape (n,)."""
        v, total, largest = self.weights.share[0], self.weights.total[0], self.weights.largest[0]
        sum_slope = total * (v @ self.log_slope)  # of Σ w_i, over the largest
        return np.asarray(-2 / np.pi * sum_slope / (1 / largest + largest * total**2))
