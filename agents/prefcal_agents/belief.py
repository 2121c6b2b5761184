"""What answers teach where some of them may be wrong: a distribution of β."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .fitting import Constraints

_SWEEPS = 40  # at most; some 20 to 30 are enough
_DAMPING = 0.7  # share of each step that is taken, all sites at once
_SETTLED = 1e-2  # largest relative change of a site's precision at which it has converged
_SHORTEST = 1e-12  # a shorter row counts as this long
_LEAST, _MOST = 1e-8, 1e8  # precisions of a site
_SURE = 1e-6  # error rate of a row that nobody answered (a weight that is 0 or more)


@dataclass(frozen=True, slots=True)
class Belief:
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
    """

    mean: Float[np.ndarray, " N"]
    root: Float[np.ndarray, "N N"]
    foretold: float
    wrong: Float[np.ndarray, " R"]

    @classmethod
    def of(cls, constraints: Constraints, error_rate: float) -> "Belief":
        """From answers of which each is wrong with chance `error_rate`; ties teach nothing."""
        from scipy.linalg.lapack import dpotrf, dtrtrs
        from scipy.special import ndtr

        strict = constraints.margins >= 0
        rows = constraints.rows[strict]
        answered = constraints.owner[strict] >= 0
        e = np.where(answered, error_rate, _SURE)
        unit = rows / np.maximum(np.sqrt(np.sum(rows * rows, axis=1)), _SHORTEST)[:, None]
        n = rows.shape[1]
        # Each row is stood in for by a normal site: its precision, and that times its mean.
        precision, shift = np.full(len(unit), 1e-6), np.zeros(len(unit))
        foretells = np.full(len(unit), 0.5)
        for _ in range(_SWEEPS):
            root, _ = dpotrf(np.eye(n) + (unit.T * precision) @ unit, lower=1, clean=1)
            across, _ = dtrtrs(root, unit.T, lower=1)
            variance = np.clip(np.sum(across * across, axis=0), 1e-10, None)
            mu = across.T @ (across @ shift)
            # What the other rows say of each.
            rest = np.maximum(1 / variance - precision, _LEAST)
            m, sd = (mu / variance - shift) / rest, 1 / np.sqrt(rest)
            z = m / sd
            foretells = ndtr(z)
            chance = np.maximum(e + (1 - 2 * e) * foretells, 1e-300)
            slope = (1 - 2 * e) * np.exp(-z * z / 2) / (np.sqrt(2 * np.pi) * chance * sd)
            after = np.maximum(sd**2 - sd**4 * slope * (z / sd + slope), 1e-12)
            target = np.clip(1 / after - rest, _LEAST, _MOST)
            to = (m + sd**2 * slope) * (rest + target) - m * rest
            change = float(np.max(np.abs(target - precision) / (1 + precision), initial=0.0))
            precision = precision + _DAMPING * (target - precision)
            shift = shift + _DAMPING * (to - shift)
            if change < _SETTLED:
                break
        root, _ = dpotrf(np.eye(n) + (unit.T * precision) @ unit, lower=1, clean=1)
        half, _ = dtrtrs(root, unit.T @ shift, lower=1)
        mean, _ = dtrtrs(root, half, lower=1, trans=1)
        chance = np.maximum(e + (1 - 2 * e) * foretells, 1e-300)
        return cls(
            mean=mean,
            root=root,
            foretold=float(np.sum(np.log(chance[answered]))),
            wrong=np.asarray((e * (1 - foretells) / chance)[answered]),
        )

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, " N"]:
        """One β at random, shape (N,)."""
        from scipy.linalg.lapack import dtrtrs

        away, _ = dtrtrs(self.root, rng.standard_normal(len(self.mean)), lower=1, trans=1)
        return np.asarray(self.mean + away)
