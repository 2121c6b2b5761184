"""Fit a Gaussian process to comparisons only."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import Preferences

from .expectation_propagation import ExpectationPropagation, Sites, unit_rows
from .matern import LONGEST, SHORTEST, matern, squares
from .preference_qp import Constraints

_LENGTH, _DOUBT = 0.35, 1.0  # prior of a length: median / √n in the cube, deviation of its log
_NUGGET = 1e-9  # variance added for the Cholesky factor; that of the process is 1
_STEPS = 10  # maximum number of steps of the fit of the lengths
_MOST = 100  # number of samples, compared last, that it is trained on, for speed
_SURE = 1e-6  # smallest error rate; 0 would leave no room for rounding


@dataclass(frozen=True, slots=True)
class PreferenceGP:
    """Mean of a Gaussian process, given comparisons of its values at N samples.

    Source: W. Chu, Z. Ghahramani, "Preference learning with Gaussian processes", ICML 2005, with
    expectation propagation (`ExpectationPropagation`) in place of their Laplace approximation.
    Deviation: replaces eq. QP-pref for some proposals (`is_process_turn`). Least weights give one
    Ĵ that keeps the answers; this is the average of all functions that (nearly) keep them, smooth
    ones weighing more, and the lengths say which knobs matter. It is trained on the last 100
    samples that were compared. Measured in docs/research/process.md.

    Args:
        centres: Samples in the unit cube, shape (N, n).
        lengths: Length ℓ of each knob, shape (n,).
        alpha: Vector K⁻¹ times the mean at the samples, shape (N,).
    """

    centres: Float[np.ndarray, "N n"]
    lengths: Float[np.ndarray, " n"]
    alpha: Float[np.ndarray, " N"]

    @classmethod
    def of(cls, preferences: Preferences, error_rate: float = 0.0) -> "PreferenceGP":
        """Fit the process with the most likely lengths; at least one answer must not be a tie.

        Each answer is wrong with probability `error_rate`.
        """
        from scipy.linalg import solve_triangular

        known = _Known.of(preferences, max(error_rate, _SURE))
        lengths, start = known.likeliest()
        factor = known.factor(lengths)[0]
        belief = known.belief(factor, start)
        alpha = solve_triangular(factor, belief.mean, lower=True, trans=1)
        return cls(known.centres, lengths, np.asarray(alpha))

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the mean at the rows of `z`, shape (m,), without unit; lower is better."""
        u = squares(z, self.centres) / self.lengths[:, None, None] ** 2
        return np.asarray(matern(u)[0] @ self.alpha)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the gradient at one point of the cube, shape (n,)."""
        away = (z - self.centres) / self.lengths
        slope = matern((away.T**2)[:, :, None])[1][:, 0]
        return np.asarray((self.alpha * slope) @ away / self.lengths)

    @property
    def spread(self) -> float:
        """Return the range of the mean over the samples."""
        return float(np.ptp(self(self.centres)))


@dataclass(frozen=True, slots=True)
class _Known:
    """R strict comparisons of N samples, each wrong with probability `error_rate`.

    Each row has a 1 at the losing sample and a -1 at the winning one.
    """

    centres: Float[np.ndarray, "N n"]
    constraints: Constraints
    apart: Float[np.ndarray, "n N N"]
    error_rate: float

    @classmethod
    def of(cls, preferences: Preferences, error_rate: float) -> "_Known":
        """Return the comparisons of the last samples, without ties."""
        strict = np.flatnonzero(preferences.b)
        first, second = preferences.first[strict], preferences.second[strict]
        samples, at = np.unique(np.stack([first, second], 1).ravel()[::-1], return_index=True)
        recent = np.sort(samples[np.argsort(at)[:_MOST]])
        kept = strict[np.isin(first, recent) & np.isin(second, recent)]
        one_each = np.eye(len(preferences.samples))[:, recent]
        centres = preferences.samples[recent]
        return cls(
            centres,
            Constraints.of(preferences.subset(kept), one_each, np.ones(len(kept))),
            squares(centres, centres),
            error_rate,
        )

    def factor(
        self, lengths: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "N N"], Float[np.ndarray, "n N N"], Float[np.ndarray, "N N"]]:
        """Return the Cholesky factor of the kernel, the scaled squares and the kernel's slope."""
        u = self.apart / lengths[:, None, None] ** 2
        kernel, slope = matern(u)
        return np.linalg.cholesky(kernel + _NUGGET * np.eye(len(kernel))), u, slope

    def belief(
        self, factor: Float[np.ndarray, "N N"], start: Sites | None
    ) -> ExpectationPropagation:
        """Return the belief about β, where the values at the samples are factor · β."""
        rows = self.constraints.rows @ factor
        return ExpectationPropagation.of(
            replace(self.constraints, rows=rows), self.error_rate, start
        )

    def likeliest(self) -> tuple[Float[np.ndarray, " n"], Sites | None]:
        """Return ℓ that maximizes evidence times a log-normal prior, and sites close to it."""
        from scipy.optimize import minimize

        n = len(self.apart)
        expected, sites = np.log(_LENGTH * np.sqrt(n)), None

        def loss(logs: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
            nonlocal sites  # each fit starts from the last sites
            factor, u, slope = self.factor(np.exp(logs))
            belief = self.belief(factor, sites)
            sites = belief.sites
            beyond = (logs - expected) / _DOUBT
            # ∂K/∂log ℓ_j = -slope u_j.
            gradient = 0.5 * np.einsum("mN,jmN->j", self._pull(factor, belief) * slope, u)
            value = -belief.evidence + 0.5 * beyond @ beyond
            return float(value), gradient + beyond / _DOUBT

        found = minimize(
            loss,
            np.full(n, expected),
            jac=True,
            method="L-BFGS-B",
            bounds=[(np.log(SHORTEST), np.log(LONGEST))] * n,
            options={"maxiter": _STEPS},
        )
        return np.asarray(np.exp(found.x)), sites

    def _pull(
        self, factor: Float[np.ndarray, "N N"], belief: ExpectationPropagation
    ) -> Float[np.ndarray, "N N"]:
        """Return twice the slope of the evidence in the kernel, at fixed sites.

        Source: Rasmussen and Williams (2006), equation 5.27, for the differences of the values.
        """
        from scipy.linalg import solve_triangular

        rows, sites = self.constraints.rows, belief.sites
        length = np.sqrt(np.sum((rows @ factor) ** 2, axis=1))
        scaled, unit = rows / length[:, None], unit_rows(rows @ factor)
        weighted = sites.precision[:, None] * scaled
        ahead = scaled.T @ (sites.shift - sites.precision * (unit @ belief.mean))
        across = solve_triangular(belief.root, unit.T @ weighted, lower=True)
        return np.asarray(np.outer(ahead, ahead) - scaled.T @ weighted + across.T @ across)
