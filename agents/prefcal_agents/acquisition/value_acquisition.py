"""Compute the acquisition of GLIS, which rewards low, uncertain and distant points.

Source: A. Bemporad, "Global optimization via inverse distance weighting and radial basis
functions", Computational Optimization and Applications 77 (2020), equations 7 to 10.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.models.interpolant import Interpolant
from prefcal_agents.models.rbf import squared_distances

_ON_SAMPLE = 1e-30  # squared distance below which a point counts as a sample
_FLAT = 1e-12  # a deviation below this has no slope worth following


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
        self, values: Float[np.ndarray, " N"], predicted: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        """Return the IDW variance s², the weighted mean of (f_i - predicted)², shape (m,).

        It is 0 on a sample.
        """
        return np.asarray(np.sum(self.share * (values - predicted[:, None]) ** 2, axis=1))

    @property
    def distance(self) -> Float[np.ndarray, " m"]:
        """Return the IDW distance z = 2/π arctan(1 / Σ w_i), in [0, 1), (m,); 0 on a sample."""
        return np.asarray(2 / np.pi * np.arctan(1 / (self.largest * self.total)))


@dataclass(frozen=True, slots=True)
class ValueAcquisition:
    """The acquisition a = f - α s - δ z over the box scaled to [-1, 1]; f interpolates scores.

    Source: equation 10, divided by its ΔF: the range of the scores is 1 here.

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
        weights, f = Weights.of(squared_distances(x, self.interpolant.centers)), self.interpolant(x)
        s = np.sqrt(weights.variance(self.values, f))
        return np.asarray(f - self.alpha * s - self.delta * weights.distance)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return a and ∂a/∂z at one point of the cube, shape (n,); s and z are flat on a sample."""
        x, centers = 2 * z - 1, self.interpolant.centers
        d = squared_distances(x[None], centers)
        weights, f = Weights.of(d), self.interpolant(x[None])
        s, slope = np.sqrt(weights.variance(self.values, f)), self.interpolant.gradient(x)
        value = float((f - self.alpha * s - self.delta * weights.distance)[0])
        if d.min() <= _ON_SAMPLE:
            return value, np.asarray(2 * slope)
        v, largest, total = weights.share[0], weights.largest[0], weights.total[0]
        of_logs = -2 * (1 + 1 / d[0])[:, None] * (x - centers)  # ∂ log w_i / ∂x, shape (N, n)
        of_s: float | Float[np.ndarray, " n"] = 0.0
        if s[0] > _FLAT:
            error = self.values - f[0]
            of_shares = v[:, None] * (of_logs - v @ of_logs)
            of_s = (error**2 @ of_shares - 2 * (v @ error) * slope) / (2 * float(s[0]))
        of_sum = total * (v @ of_logs)  # of Σ w_i, over the largest
        of_z = -2 / np.pi * of_sum / (1 / largest + largest * total**2)
        return value, np.asarray(2 * (slope - self.alpha * of_s - self.delta * of_z))
