"""Fit a Gaussian process to the values of Ĵ at the samples."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .matern import LONGEST, SHORTEST, matern, squares

_LENGTH, _DOUBT = 0.5, 1.0  # prior of a length: median in the cube, deviation of its logarithm
_NOISE = 1e-8  # relative noise variance; 1e-6 kept samples from converging
_FITTED = 100  # number of latest samples that the lengths are fit to, for speed
_STEPS = 25  # maximum number of steps of that fit


@dataclass(frozen=True, slots=True)
class GaussianProcess:
    """A Gaussian process through N samples, with mean and standard deviation anywhere.

    Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
    algorithm 2.1, kernel `matern` with a length for each knob. The lengths maximize the posterior
    of section 5.2; mean and variance follow from them.

    Args:
        centres: Samples in the unit cube, shape (N, n).
        lengths: Length ℓ of each knob, shape (n,).
        mean: Mean far from all samples.
        variance: Variance far from all samples.
        alpha: Vector K⁻¹ (values - mean), shape (N,).
        factor: Lower Cholesky factor of K, the kernel between all samples, shape (N, N).
    """

    centres: Float[np.ndarray, "N n"]
    lengths: Float[np.ndarray, " n"]
    mean: float
    variance: float
    alpha: Float[np.ndarray, " N"]
    factor: Float[np.ndarray, "N N"]

    @classmethod
    def through(
        cls, centres: Float[np.ndarray, "N n"], values: Float[np.ndarray, " N"]
    ) -> "GaussianProcess":
        """Fit the process to `values` at `centres`, with the most likely lengths; N >= 1."""
        last = slice(max(len(values) - _FITTED, 0), None)
        return cls._with(centres, values, _likeliest(centres[last], values[last]))

    @classmethod
    def _with(
        cls,
        centres: Float[np.ndarray, "N n"],
        values: Float[np.ndarray, " N"],
        lengths: Float[np.ndarray, " n"],
    ) -> "GaussianProcess":
        from scipy.linalg import cho_solve  # takes a tenth of a second to import

        kernel = matern(squares(centres, centres) / lengths[:, None, None] ** 2)[0]
        factor = np.linalg.cholesky(kernel + _NOISE * np.eye(len(values)))
        ones = cho_solve((factor, True), np.ones(len(values)))
        mean = float(ones @ values / ones.sum())
        alpha = cho_solve((factor, True), values - mean)
        variance = float((values - mean) @ alpha) / len(values)
        return cls(centres, lengths, mean, max(variance, 1e-300), alpha, factor)

    def __call__(
        self, z: Float[np.ndarray, "m n"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Return mean and standard deviation at the rows of `z`, unit cube, shape (m,) each."""
        from scipy.linalg import solve_triangular

        k = matern(squares(z, self.centres) / self.lengths[:, None, None] ** 2)[0]
        v = solve_triangular(self.factor, k.T, lower=True)
        share = np.maximum(1 + _NOISE - np.sum(v * v, axis=0), _NOISE**2)
        return self.mean + k @ self.alpha, np.sqrt(self.variance * share)

    def slopes(
        self, z: Float[np.ndarray, " n"]
    ) -> tuple[float, float, Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return mean and standard deviation at one point, and their gradients, shape (n,)."""
        from scipy.linalg import solve_triangular

        away = (z - self.centres) / self.lengths
        k, slope = matern((away.T**2)[:, :, None])
        gradient = slope[:, 0, None] * away / self.lengths
        v = solve_triangular(self.factor, k[:, 0], lower=True)
        weights = solve_triangular(self.factor, v, lower=True, trans=1)
        share = max(1 + _NOISE - float(v @ v), _NOISE**2)
        deviation = float(np.sqrt(self.variance * share))
        of_deviation = -self.variance * (weights @ gradient) / deviation
        return (
            self.mean + float(k[:, 0] @ self.alpha),
            deviation,
            self.alpha @ gradient,
            of_deviation,
        )


def _likeliest(
    centres: Float[np.ndarray, "N n"], values: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " n"]:
    """Return ℓ at the maximum of the posterior, with a log-normal prior."""
    from scipy.optimize import minimize

    apart, eye = squares(centres, centres), np.eye(len(values))

    def loss(logs: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        u = apart / np.exp(2 * logs)[:, None, None]
        kernel, slope = matern(u)
        factor = np.linalg.cholesky(kernel + _NOISE * eye)
        inverse = np.linalg.inv(kernel + _NOISE * eye)
        rest = values - np.sum(inverse @ values) / np.sum(inverse)
        alpha = inverse @ rest
        variance = max(float(rest @ alpha) / len(values), 1e-300)
        beyond = (logs - np.log(_LENGTH)) / _DOUBT
        value = len(values) / 2 * np.log(variance) + np.sum(np.log(np.diag(factor)))
        # ∂K/∂log ℓ_j = -slope u_j; Rasmussen and Williams, equation 5.9.
        inner = (inverse - np.outer(alpha, alpha) / variance) * slope
        gradient = -0.5 * np.einsum("mN,jmN->j", inner, u) + beyond / _DOUBT
        return float(value + 0.5 * beyond @ beyond), gradient

    found = minimize(
        loss,
        np.full(centres.shape[1], np.log(_LENGTH)),
        jac=True,
        method="L-BFGS-B",
        bounds=[(np.log(SHORTEST), np.log(LONGEST))] * centres.shape[1],
        options={"maxiter": _STEPS},
    )
    return np.asarray(np.exp(found.x))
