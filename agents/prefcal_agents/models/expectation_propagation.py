"""Estimate the distribution of β from answers, some of which may be wrong."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .preference_qp import Constraints

_SWEEPS = 40  # maximum; 20 to 30 are enough unless answers that are surely right contradict
_DAMPING = 0.7  # share of each step to take, for all sites at once
_SETTLED = 1e-2  # converged when no site's precision changes relatively by more than this
_SHORTEST = 1e-12  # a shorter row counts as this long
_LEAST, _MOST = 1e-8, 1e8  # bounds of a site's precision
_FLAT = 1e-6  # precision of a site without information
_SURE = 1e-6  # error rate of a row that is not an answer (a weight that must be 0 or more)


@dataclass(frozen=True, slots=True)
class Sites:
    """Normal distributions that approximate R answers, over rows · β with rows of length 1.

    Args:
        precision: Precision of each site, shape (R,).
        shift: Precision times mean of each site, shape (R,).
    """

    precision: Float[np.ndarray, " R"]
    shift: Float[np.ndarray, " R"]

    @classmethod
    def flat(cls, count: int) -> "Sites":
        """Return `count` sites without information."""
        return cls(np.full(count, _FLAT), np.zeros(count))

    def towards(self, other: "Sites") -> "Sites":
        """Return the sites after a damped step towards `other`."""
        return Sites(
            self.precision + _DAMPING * (other.precision - self.precision),
            self.shift + _DAMPING * (other.shift - self.shift),
        )


@dataclass(frozen=True, slots=True)
class ExpectationPropagation:
    """A normal distribution of β, from answers that are each wrong with some probability.

    The prior of β is standard normal, which matches βᵀβ in eq. QP-pref. An answer is right with
    probability 1 - e: only the signs of rows · β count, not their margins. So an answer that all
    others contradict has little influence, whereas with the slack of eq. QP-pref a mistake pulls
    harder the worse it is.

    Source: expectation propagation for such a likelihood, Kim and Ghahramani, SSPR 2008.
    Deviation: replaces eq. QP-pref if answers contradict each other.

    Args:
        mean: Mean of β, shape (N,).
        root: Lower Cholesky factor of the precision of β, shape (N, N).
        predicted: Sum of the log probabilities of the answers, each predicted from the others.
        wrong: Probability that each row is a mistake, shape (R,).
        evidence: Log probability of all rows together.
        sites: Sites of the rows; a starting point for similar fits.
    """

    mean: Float[np.ndarray, " N"]
    root: Float[np.ndarray, "N N"]
    predicted: float
    wrong: Float[np.ndarray, " R"]
    evidence: float
    sites: Sites

    @classmethod
    def of(
        cls, constraints: Constraints, error_rate: float, start: Sites | None = None
    ) -> "ExpectationPropagation":
        """Fit to answers that are each wrong with probability `error_rate`; ties are ignored.

        Starting from the sites `start` is faster and gives the same result within tolerance.
        """
        from scipy.linalg.lapack import dtrtrs

        strict = constraints.margins >= 0
        unit = unit_rows(constraints.rows[strict])
        answered = constraints.owner[strict] >= 0
        e = np.where(answered, error_rate, _SURE)
        sites = Sites.flat(len(unit)) if start is None else start
        for _ in range(_SWEEPS):
            matched = _Rest.of(unit, sites).matched(e)
            change = np.abs(matched.precision - sites.precision) / (1 + sites.precision)
            sites = sites.towards(matched)
            if np.max(change, initial=0.0) < _SETTLED:
                break
        rest = _Rest.of(unit, sites)
        mean, _ = dtrtrs(rest.root, rest.half, lower=1, trans=1)
        chance, right = rest.chance(e)
        return cls(
            mean=mean,
            root=rest.root,
            predicted=float(np.sum(np.log(chance[answered]))),
            wrong=np.asarray((e * (1 - right) / chance)[answered]),
            evidence=rest.evidence(sites, chance),
            sites=sites,
        )

    def deviations(self, rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, " R"]:
        """Return how many standard deviations each of rows · β is above 0, shape (R,)."""
        from scipy.linalg.lapack import dtrtrs

        across, _ = dtrtrs(self.root, rows.T, lower=1)
        deviation = np.maximum(np.sqrt(np.sum(across * across, axis=0)), _SHORTEST)
        return np.asarray(rows @ self.mean / deviation)


@dataclass(frozen=True, slots=True)
class _Rest:
    """The posterior of β from all rows, and for each row the cavity: what the other rows say."""

    root: Float[np.ndarray, "N N"]
    half: Float[np.ndarray, " N"]
    m: Float[np.ndarray, " R"]
    precision: Float[np.ndarray, " R"]

    @classmethod
    def of(cls, unit: Float[np.ndarray, "R N"], sites: Sites) -> "_Rest":
        from scipy.linalg.lapack import dpotrf, dtrtrs

        inner = np.eye(unit.shape[1]) + (unit.T * sites.precision) @ unit
        root, _ = dpotrf(inner, lower=1, clean=1)
        across, _ = dtrtrs(root, unit.T, lower=1)
        variance = np.clip(np.sum(across * across, axis=0), 1e-10, None)
        half = across @ sites.shift
        precision = np.maximum(1 / variance - sites.precision, _LEAST)
        m = (across.T @ half / variance - sites.shift) / precision
        return cls(root, half, m, precision)

    def chance(
        self, e: Float[np.ndarray, " R"]
    ) -> tuple[Float[np.ndarray, " R"], Float[np.ndarray, " R"]]:
        """Return the probability of each answer given the error rate, and of its being true."""
        from scipy.special import ndtr

        right = ndtr(self.m * np.sqrt(self.precision))
        return np.maximum(e + (1 - 2 * e) * right, 1e-300), right

    def matched(self, e: Float[np.ndarray, " R"]) -> Sites:
        """Return the sites that match the true mean and variance of each answer."""
        z, v = self.m * np.sqrt(self.precision), 1 / self.precision
        density = np.exp(-z * z / 2) / np.sqrt(2 * np.pi * v)
        slope = (1 - 2 * e) * density / self.chance(e)[0]
        after = np.maximum(v - v * v * slope * (self.m / v + slope), 1e-12)
        target = np.clip(1 / after - self.precision, _LEAST, _MOST)
        to = (self.m + v * slope) * (self.precision + target) - self.m * self.precision
        return Sites(target, to)

    def evidence(self, sites: Sites, chance: Float[np.ndarray, " R"]) -> float:
        """Return the log of the integral over β of prior and sites, scaled like the answers."""
        whole = self.precision + sites.precision
        pull = (self.m * self.precision + sites.shift) ** 2 / whole - self.m**2 * self.precision
        each = np.log(chance) + 0.5 * np.log(whole / self.precision) - 0.5 * pull
        together = 0.5 * self.half @ self.half - np.sum(np.log(np.diag(self.root)))
        return float(np.sum(each) + together)


def unit_rows(rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, "R N"]:
    """Return the rows scaled to length 1, which keeps the signs of rows · β."""
    length = np.sqrt(np.sum(rows * rows, axis=1))
    return np.asarray(rows / np.maximum(length, _SHORTEST)[:, None])
