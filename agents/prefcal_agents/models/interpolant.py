"""Interpolate known values by radial basis functions, with leave-one-out errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .rbf import RADIAL_FUNCTIONS, squared_distances

POSITIVE_DEFINITE = ("gaussian", "inverse_quadratic")
"""Radial functions with a positive definite matrix over all pairs of samples."""

_DECIDING = 100  # maximum number of samples that choose ε; with 400 it took 0.1 s
_RIDGE = 1e-10  # relative to φ(0) = 1: far below any relevant value, but above rounding


@dataclass(frozen=True, slots=True)
class Interpolant:
    """The interpolant Σ β_i φ(ε |z - z_i|) + offset, with N centers.

    Source: Bemporad 2020, equation 3; φ takes the distance there, its square in eq. rbf.

    Args:
        centers: Centers, shape (N, n).
        beta: Weights β, shape (N,).
        offset: Mean of the values, predicted far from all samples.
        epsilon: Width parameter ε.
        rbf: Name of φ, one of `POSITIVE_DEFINITE`.
    """

    centers: Float[np.ndarray, "N n"]
    beta: Float[np.ndarray, " N"]
    offset: float
    epsilon: float
    rbf: str

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the values at the rows of `z`, shape (m,)."""
        u = self.epsilon**2 * squared_distances(z, self.centers)
        return np.asarray(self.offset + RADIAL_FUNCTIONS[self.rbf].value(u) @ self.beta)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the gradient at one point, shape (n,)."""
        away = z - self.centers
        slope = RADIAL_FUNCTIONS[self.rbf].slope(self.epsilon**2 * np.sum(away**2, axis=1))
        return np.asarray((2 * self.epsilon**2 * self.beta * slope) @ away)


def interpolate(
    samples: Float[np.ndarray, "N n"], values: Float[np.ndarray, " N"], epsilon: float, rbf: str
) -> tuple[Interpolant, float]:
    """Return the interpolant of `values` at `samples`, and its error.

    The error is the root mean square difference between each value and its prediction from the
    others. One factorization gives all of them: S. Rippa, Advances in Computational Mathematics
    11 (1999), equation 13.
    """
    column = values[:, None]
    offset = column.mean(axis=0)
    phi = RADIAL_FUNCTIONS[rbf].value(epsilon**2 * squared_distances(samples, samples))
    eigenvalues, vectors = np.linalg.eigh(phi)
    inverse = 1 / (np.maximum(eigenvalues, 0.0) + _RIDGE * len(values))
    beta = vectors @ (inverse[:, None] * (vectors.T @ (column - offset)))
    left_out = beta / ((vectors**2) @ inverse)[:, None]
    error = np.sqrt(np.mean(left_out**2, axis=0))
    return Interpolant(samples, beta[:, 0], float(offset[0]), epsilon, rbf), float(error[0])


def best_interpolant(
    samples: Float[np.ndarray, "N n"], values: Float[np.ndarray, " N"], epsilons: Sequence[float], rbf: str
) -> Interpolant:
    """Return the interpolant with the ε of `epsilons` that predicts left-out values best.

    With many samples, only the last ones choose ε.
    """
    last = slice(max(len(samples) - _DECIDING, 0), None)
    tries = [interpolate(samples[last], values[last], epsilon, rbf) for epsilon in epsilons]
    best = min(tries, key=lambda each: each[1])[0]
    if len(samples) <= _DECIDING:
        return best
    return interpolate(samples, values, best.epsilon, rbf)[0]


def normalized(values: Float[np.ndarray, " N"], ceiling: float) -> Float[np.ndarray, " N"]:
    """Return `values` as shares of their range: 0 for the best, 1 for the worst; all 0 if equal.

    Values more than `ceiling` (median - best) above the median are capped there first.
    """
    largest = float(np.abs(values).max())
    shares = values / (largest if largest > 0 else 1.0)  # differences of huge values overflow
    ordered, middle = np.sort(shares), len(shares) // 2
    best, median = ordered[0], 0.5 * (ordered[middle] + ordered[-1 - middle])
    if median > best:
        shares = np.minimum(shares, median + ceiling * (median - best))
    spread = float(np.ptp(shares))
    return np.asarray((shares - best) / (spread if spread > 0 else 1.0))
