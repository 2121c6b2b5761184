"""Radial basis functions through known values, and how well they foretell one left out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .rbf import RADIAL_FUNCTIONS, squared_distances

POSITIVE_DEFINITE = ("gaussian", "inverse_quadratic")
"""The radial functions whose matrix of all pairs of samples is positive definite."""

_DECIDING = 100  # samples, at most, by which ε is chosen: with 400 it took 0.1 s
_RIDGE = 1e-10  # relative to φ(0) = 1: far below any value that matters, above rounding


@dataclass(frozen=True, slots=True)
class Interpolant:
    """Σ β_i φ(ε |z - z_i|) + offset, with N centres.

    Source: Bemporad 2020, equation 3; φ takes the distance there, its square in eq. rbf.

    Args:
        centres: Shape (N, n).
        beta: Shape (N,).
        offset: The mean of the values: what is foretold far from all samples.
        epsilon: ε.
        rbf: Name of φ, one of `POSITIVE_DEFINITE`.
    """

    centres: Float[np.ndarray, "N n"]
    beta: Float[np.ndarray, " N"]
    offset: float
    epsilon: float
    rbf: str

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Values at the rows of `z`, shape (m,)."""
        u = self.epsilon**2 * squared_distances(z, self.centres)
        return np.asarray(self.offset + RADIAL_FUNCTIONS[self.rbf].value(u) @ self.beta)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Gradient at one point, shape (n,)."""
        away = z - self.centres
        slope = RADIAL_FUNCTIONS[self.rbf].slope(self.epsilon**2 * np.sum(away**2, axis=1))
        return np.asarray((2 * self.epsilon**2 * self.beta * slope) @ away)


def interpolate(
    samples: Float[np.ndarray, "N n"],
    values: Float[np.ndarray, " N"],
    epsilon: float,
    rbf: str,
) -> tuple[Interpolant, float]:
    """The interpolant of `values` at `samples`, and its leave-one-out error.

    The error is the root mean square of what each value differs from the one foretold without
    it, which follows from one factorisation: S. Rippa, Advances in Computational Mathematics 11
    (1999), equation 13.
    """
    return _interpolate(samples, values[:, None], epsilon, rbf)[0]


def _interpolate(
    samples: Float[np.ndarray, "N n"],
    columns: Float[np.ndarray, "N p"],
    epsilon: float,
    rbf: str,
) -> list[tuple[Interpolant, float]]:
    """The same of p columns of values, with one factorisation."""
    offsets = columns.mean(axis=0)
    phi = RADIAL_FUNCTIONS[rbf].value(epsilon**2 * squared_distances(samples, samples))
    eigenvalues, vectors = np.linalg.eigh(phi)
    inverse = 1 / (np.maximum(eigenvalues, 0.0) + _RIDGE * len(columns))
    betas = vectors @ (inverse[:, None] * (vectors.T @ (columns - offsets)))
    left_out = betas / ((vectors**2) @ inverse)[:, None]
    errors = np.sqrt(np.mean(left_out**2, axis=0))
    return [
        (Interpolant(samples, betas[:, k], float(offsets[k]), epsilon, rbf), float(errors[k]))
        for k in range(columns.shape[1])
    ]


def best_interpolants(
    samples: Float[np.ndarray, "N n"],
    columns: Float[np.ndarray, "N p"],
    epsilons: Sequence[float],
    rbf: str,
) -> tuple[tuple[Interpolant, float], ...]:
    """For each of p columns, that with the ε of `epsilons` that foretells left-out values best.

    With its leave-one-out error. Of many samples the last ones decide.
    """
    last = slice(max(len(samples) - _DECIDING, 0), None)
    tries = [_interpolate(samples[last], columns[last], epsilon, rbf) for epsilon in epsilons]
    best = tuple(min(found, key=lambda f: f[1]) for found in zip(*tries, strict=True))
    if len(samples) <= _DECIDING:
        return best
    chosen = {model.epsilon for model, _ in best}
    whole = {epsilon: _interpolate(samples, columns, epsilon, rbf) for epsilon in chosen}
    return tuple((whole[m.epsilon][k][0], error) for k, (m, error) in enumerate(best))


def best_interpolant(
    samples: Float[np.ndarray, "N n"],
    values: Float[np.ndarray, " N"],
    epsilons: Sequence[float],
    rbf: str,
) -> Interpolant:
    """The interpolant with the ε of `epsilons` that foretells left-out values best."""
    return best_interpolants(samples, values[:, None], epsilons, rbf)[0][0]


def normalised(values: Float[np.ndarray, " N"], ceiling: float) -> Float[np.ndarray, " N"]:
    """`values` as shares of their range: 0 for the best, 1 for the worst; all 0 where equal.

    Those more than `ceiling` (median - best) above the median are cut off there first.
    """
    largest = float(np.abs(values).max())
    shares = values / (largest if largest > 0 else 1.0)  # differences of huge values overflow
    best, median = shares.min(), np.median(shares)
    if median > best:
        shares = np.minimum(shares, median + ceiling * (median - best))
    spread = float(np.ptp(shares))
    return np.asarray((shares - best) / (spread if spread > 0 else 1.0))
