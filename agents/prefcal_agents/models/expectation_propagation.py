"""What answers teach where some of them may be wrong: a distribution of β."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .preference_qp import Constraints

_SWEEPS = 40  # at most; some 20 to 30 are enough unless sure answers contradict each other
_DAMPING = 0.7  # share of each step that is taken, all sites at once
_SETTLED = 1e-2  # largest relative change of a site's precision at which it has converged
_SHORTEST = 1e-12  # a shorter row counts as this long
_LEAST, _MOST = 1e-8, 1e8  # precisions of a site
_FLAT = 1e-6  # precision of a site of which nothing is known
_SURE = 1e-6  # error rate of a row that nobody answered (a weight that is 0 or more)


@dataclass(frozen=True, slots=True)
class Sites:
    """Normal distributions that stand in for R answers, of the rows · β scaled to length 1.

    Args:
        precision: Of each, shape (R,).
        shift: Precision times mean, shape (R,).
    """

    precision: Float[np.ndarray, " R"]
    shift: Float[np.ndarray, " R"]

    @classmethod
    def flat(cls, count: int) -> "Sites":
        """Those of `count` answers of which nothing is known yet."""
        return cls(np.full(count, _FLAT), np.zeros(count))

    def towards(self, other: "Sites") -> "Sites":
        """A damped step."""
        return Sites(
            self.precision + _DAMPING * (other.precision - self.precision),
            self.shift + _DAMPING * (other.shift - self.shift),
        )


@dataclass(frozen=True, slots=True)
class ExpectationPropagation:
    """A normal distribution of β, from answers of which each is wrong with some chance.

    A priori β is standard normal, as βᵀβ in eq. QP-pref says, and an answer is right with
    probability 1 - e: only the signs of the rows · β count, not their margins. So the
    influence of an answer ends where all others contradict it, while the slack of eq. QP-pref lets
    a mistake pull the harder the worse it is.

    Source: expectation propagation for such a likelihood, Kim and Ghahramani, SSPR 2008.
    Deviation: in place of eq. QP-pref, where answers contradict each other.

    Args:
        mean: Of β, shape (N,).
        root: Lower Cholesky factor of its precision, shape (N, N).
        foretold: Sum of the log probabilities of the answers, each as the others foretell it.
        wrong: How likely each row is a mistake, shape (R,).
        evidence: Log probability of all rows together.
        sites: What stands in for the rows; a start for similar ones.
    """

    mean: Float[np.ndarray, " N"]
    root: Float[np.ndarray, "N N"]
    foretold: float
    wrong: Float[np.ndarray, " R"]
    evidence: float
    sites: Sites

    @classmethod
    def of(
        cls, constraints: Constraints, error_rate: float, start: Sites | None = None
    ) -> "ExpectationPropagation":
        """From answers of which each is wrong with chance `error_rate`; ties teach nothing.

        The search begins with the sites `start`: quicker, and the same within its tolerance.
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
        chance, foretells = rest.chance(e)
        return cls(
            mean=mean,
            root=rest.root,
            foretold=float(np.sum(np.log(chance[answered]))),
            wrong=np.asarray((e * (1 - foretells) / chance)[answered]),
            evidence=rest.evidence(sites, chance),
            sites=sites,
        )

    def deviations(self, rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, " R"]:
        """By how many standard deviations each of rows · β is above 0, shape (R,)."""
        from scipy.linalg.lapack import dtrtrs

        across, _ = dtrtrs(self.root, rows.T, lower=1)
        deviation = np.maximum(np.sqrt(np.sum(across * across, axis=0)), _SHORTEST)
        return np.asarray(rows @ self.mean / deviation)


@dataclass(frozen=True, slots=True)
class _Rest:
    """What all rows together say of β, and what all other rows say of each: its cavity."""

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
        """Probability of each answer, wrong ones among them, and of its being true."""
        from scipy.special import ndtr

        foretells = ndtr(self.m * np.sqrt(self.precision))
        return np.maximum(e + (1 - 2 * e) * foretells, 1e-300), foretells

    def matched(self, e: Float[np.ndarray, " R"]) -> Sites:
        """The sites with which each answer has its true mean and variance."""
        z, v = self.m * np.sqrt(self.precision), 1 / self.precision
        density = np.exp(-z * z / 2) / np.sqrt(2 * np.pi * v)
        slope = (1 - 2 * e) * density / self.chance(e)[0]
        after = np.maximum(v - v * v * slope * (self.m / v + slope), 1e-12)
        target = np.clip(1 / after - self.precision, _LEAST, _MOST)
        to = (self.m + v * slope) * (self.precision + target) - self.m * self.precision
        return Sites(target, to)

    def evidence(self, sites: Sites, chance: Float[np.ndarray, " R"]) -> float:
        """Log of the integral over β of the prior and all sites, scaled as the answers are."""
        whole = self.precision + sites.precision
        pull = (self.m * self.precision + sites.shift) ** 2 / whole - self.m**2 * self.precision
        each = np.log(chance) + 0.5 * np.log(whole / self.precision) - 0.5 * pull
        together = 0.5 * self.half @ self.half - np.sum(np.log(np.diag(self.root)))
        return float(np.sum(each) + together)


def unit_rows(rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, "R N"]:
    """The rows scaled to length 1, which leaves the signs of rows · β."""
    length = np.sqrt(np.sum(rows * rows, axis=1))
    return np.asarray(rows / np.maximum(length, _SHORTEST)[:, None])
