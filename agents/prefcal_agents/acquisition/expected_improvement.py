"""Compute expected improvement: by how much a θ is expected to beat the best value."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.models.gaussian_process import GaussianProcess
from prefcal_agents.models.interpolant import normalized

_CEILING = 2.0  # see `normalized`: values far worse than most must not flatten the rest
_FAR = -1e3  # standard deviations; below, the difference of two numbers near 1 is lost


@dataclass(frozen=True, slots=True)
class ExpectedImprovement:
    """The objective -log(expected improvement), to minimize, over S functions equally likely.

    Source: D. R. Jones, M. Schonlau, W. J. Welch, "Efficient global optimization of expensive
    black-box functions", Journal of Global Optimization 13 (1998), equation 15; in logarithms,
    since far from the best the gain itself is 0 in floating point.

    Args:
        process: Gaussian processes of the functions, in shares of their range over the samples.
    """

    process: GaussianProcess

    @classmethod
    def of(
        cls, samples: Float[np.ndarray, "N n"], costs: Float[np.ndarray, "S N"]
    ) -> "ExpectedImprovement":
        """Create it from S costs of N samples, points of the unit cube; lower is better."""
        shares = np.array([normalized(cost, _CEILING) for cost in costs])
        return cls(GaussianProcess.through(samples, shares))

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return -log EI at the rows of `z`, shape (m,)."""
        mean, deviation = self.process(z)
        logs = np.log(deviation) + _log_gain(-mean / deviation)[0]
        return np.asarray(-_log_mean(logs.T))

    def value_and_gradient(
        self, z: Float[np.ndarray, " n"]
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return -log EI and its gradient at one point, shape (n,)."""
        mean, deviation, of_mean, of_deviation = self.process.slopes(z)
        u = -mean / deviation  # the best sample has 0
        of_u = -(of_mean + u[:, None] * of_deviation) / deviation[:, None]
        gain, of_gain = _log_gain(u)
        logs = np.log(deviation) + gain
        of_logs = of_deviation / deviation[:, None] + of_gain[:, None] * of_u
        value = float(_log_mean(logs[:, None])[0])
        shares = np.exp(logs - np.log(len(logs)) - value)
        return -value, np.asarray(-shares @ of_logs)


def _log_mean(logs: Float[np.ndarray, "S m"]) -> Float[np.ndarray, " m"]:
    """Return the logarithm of the mean of exp(logs) over the S rows."""
    largest = logs.max(axis=0)
    return np.asarray(largest + np.log(np.mean(np.exp(logs - largest), axis=0)))


def _log_gain(
    u: Float[np.ndarray, "*shape"],
) -> tuple[Float[np.ndarray, "*shape"], Float[np.ndarray, "*shape"]]:
    """Return log(φ(u) + u Φ(u)) and its slope, with φ and Φ of the normal distribution."""
    from scipy.special import erfcx, ndtr

    above, below = np.maximum(u, -1.0), np.minimum(u, -1.0)
    density = np.exp(-0.5 * above**2) / np.sqrt(2 * np.pi)
    gain = density + above * ndtr(above)
    ratio = np.sqrt(np.pi / 2) * erfcx(-below / np.sqrt(2))  # Φ/φ
    rest = np.where(below < _FAR, below**-2.0, 1 + below * ratio)
    tail = -0.5 * below**2 - 0.5 * np.log(2 * np.pi) + np.log(rest)
    return np.where(u > -1, np.log(gain), tail), np.where(u > -1, ndtr(above) / gain, ratio / rest)
