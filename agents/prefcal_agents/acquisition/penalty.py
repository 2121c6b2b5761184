"""Learn from the mark "unsafe", so that proposals avoid places that are likely unsafe.

The mark "good enough" is recorded and reported but does not change proposals, since that brought
no gain (docs/research/archive.md).

Source: M. Zhu, D. Piga, A. Bemporad, "C-GLISp: Preference-based global optimization under unknown
constraints with applications to controller calibration", IEEE Transactions on Control Systems
Technology 30 (2022).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve

from prefcal_agents.history.lessons import MOST, Marks
from prefcal_agents.models.rbf import RADIAL_FUNCTIONS, squared_distances
from prefcal_agents.optimize.search import Objective
from prefcal_env.preferences.history import History

_RBF = RADIAL_FUNCTIONS["inverse_quadratic"]
_LENGTHS = (0.1, 0.2, 0.4, 0.8)  # candidate length scales of a mark, per knob
_JUDGED = 100  # number of latest samples that choose the length scale, for speed
_VARIANCE = 25.0  # variance of the log odds: after one mark, its label has about 90 %
_STEPS = 30  # maximum steps of Newton's method, which takes about 7
_RECENT = 20  # number of latest samples whose unsafe marks raise the required safety
_RELAXED = 0.5  # share of the risk that is still accepted after each of them
POOL = 300  # random points to choose from when replacing a planned point that is likely unsafe


@dataclass(frozen=True, slots=True)
class SafetyModel:
    """The probability of a label over the cube, by a Gaussian process on the log odds.

    Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
    section 3.4: the mode of the posterior, whose log odds are Σ α_i φ + offset.
    Deviation: C-GLISp interpolates labels by inverse distances, which cannot see an edge beyond
    the samples: marks then prevented fewer unsafe experiments (docs/research/archive.md).

    Args:
        centers: K labeled samples, shape (K, n).
        alpha: Weights α, shape (K,).
        offset: Log odds far from all samples.
        length: Length scale of a label, above 0, in units of the cube per knob.
    """

    centers: Float[np.ndarray, "K n"]
    alpha: Float[np.ndarray, " K"]
    offset: float
    length: float

    @classmethod
    def of(cls, samples: Float[np.ndarray, "K n"], labels: Bool[np.ndarray, " K"]) -> "SafetyModel":
        """Learn from the labels of K samples, with the length scale that explains them best.

        With more than `MOST` samples, keep those with the rarer label and the latest others.
        """
        # Count one label of each kind more, so that labels of a single kind never mean certainty.
        offset = float(np.log((1 + np.sum(labels)) / (1 + np.sum(~labels))))
        if len(labels) > MOST:
            common = labels == (np.mean(labels) > 0.5)
            kept = np.sort(np.lexsort((-np.arange(len(labels)), common))[:MOST])
            samples, labels = samples[kept], labels[kept]
        d = squared_distances(samples, samples) / samples.shape[1]
        last = slice(max(len(labels) - _JUDGED, 0), None)
        fits = [_mode(_kernel(d[last, last], at), labels[last], offset) for at in _LENGTHS]
        best = max(range(len(fits)), key=lambda k: fits[k][1])
        alpha, length = fits[best][0], _LENGTHS[best]
        if len(alpha) < len(labels):
            alpha = _mode(_kernel(d, length), labels, offset)[0]
        return cls(samples, _VARIANCE * alpha, offset, length)

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the probability at the rows of `z`, shape (m, n), as shape (m,)."""
        phi = _kernel(squared_distances(z, self.centers) / z.shape[1], self.length)
        return _logistic(self.offset + phi @ self.alpha)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the gradient at one point, shape (n,)."""
        p = self(z[None])[0]
        away = z - self.centers
        per = self.length**2 * len(z)
        slope = _RBF.slope(np.sum(away * away, axis=1) / per)
        return np.asarray(p * (1 - p) * (2 / per) * ((self.alpha * slope) @ away))


def _kernel(d: Float[np.ndarray, "m N"], length: float) -> Float[np.ndarray, "m N"]:
    return np.asarray(_RBF.value(d / length**2))


def _logistic(x: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    return np.asarray(0.5 * (1 + np.tanh(0.5 * x)))


def _mode(
    phi: Float[np.ndarray, "K K"], labels: Bool[np.ndarray, " K"], offset: float
) -> tuple[Float[np.ndarray, " K"], float]:
    """Return the slopes of the log likelihood at the mode, shape (K,), and the log evidence.

    Source: Rasmussen and Williams, algorithm 3.1, started at 0.
    """
    kernel, sign = _VARIANCE * phi, np.where(labels, 1.0, -1.0)
    f, a = np.zeros(len(labels)), np.zeros(len(labels))
    for _ in range(_STEPS):
        p = _logistic(offset + f)
        w = p * (1 - p)
        root = np.sqrt(w)
        factor = cho_factor(np.eye(len(w)) + root[:, None] * kernel * root, lower=True)
        b = w * f + labels - p
        a = b - root * cho_solve(factor, root * (kernel @ b))
        before, f = f, kernel @ a
        if np.max(np.abs(f - before)) < 1e-6:
            break
    likelihood = -np.sum(np.logaddexp(0.0, -sign * (offset + f)))
    return a, float(likelihood - 0.5 * a @ f - np.sum(np.log(np.diag(factor[0]))))


@dataclass(frozen=True, slots=True)
class Penalty:
    """A penalty if the predicted `safety` is low: `weight` where it is 0, none from `least` on.

    It is flat where a place is likely safe, so that the acquisition alone decides there: any slope,
    however small, would keep the samples from converging to the optimum.
    """

    safety: SafetyModel
    least: float
    weight: float

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the penalty at the rows of `z`, shape (m,)."""
        return np.asarray(self.weight * np.maximum(1 - self.safety(z) / self.least, 0.0) ** 2)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return value and gradient at one point of the cube, shape (n,)."""
        lack = max(1 - self.safety(z[None])[0] / self.least, 0.0)
        slope = -2 * self.weight * lack / self.least * self.safety.gradient(z)
        return float(self(z[None])[0]), np.asarray(slope)


@dataclass(frozen=True, slots=True)
class Penalized:
    """An acquisition plus the penalty from unsafe marks.

    Source: the acquisition of C-GLISp, with its term for feasibility.
    Deviation: the term is squared beyond a threshold instead of linear, see `Penalty`; there is no
    term for satisfaction.
    """

    acquisition: Objective
    penalty: Penalty

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the values at the rows of `z`, shape (m,)."""
        return np.asarray(self.acquisition(z) + self.penalty(z))

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return value and gradient at one point, shape (n,)."""
        value, slope = self.acquisition.value_and_gradient(z)
        extra, extra_slope = self.penalty.value_and_gradient(z)
        return value + extra, np.asarray(slope + extra_slope)


def unsafe_penalty(history: History, weight: float, least_safe: float) -> Penalty | None:
    """Return the cost of likely unsafe places after `history`; None without unsafe samples.

    Each unsafe sample among the latest ones halves the accepted risk.

    Args:
        history: Samples and answers.
        weight: Penalty for a place that is certainly unsafe, 0 or more.
        least_safe: Minimum probability of being safe for no penalty.
    """
    if not weight or not history.unsafe():
        return None
    marks = Marks.of(history)
    recent = np.count_nonzero(marks.unsafe[-_RECENT:])
    least = 1 - (1 - least_safe) * _RELAXED**recent
    return Penalty(SafetyModel.of(marks.samples, ~marks.unsafe), least, weight)


def replaced(
    planned: Float[np.ndarray, " n"],
    others: Float[np.ndarray, "m n"],
    pool: Float[np.ndarray, "k n"],
    penalty: Penalty,
) -> Float[np.ndarray, " n"]:
    """Return `planned`, or the best of `pool` if `planned` is likely unsafe, shape (n,).

    The best point is safe and far from all `others`, shape (m, n), as in the initial design.
    """
    if penalty.safety(planned[None])[0] >= penalty.least:
        return planned
    apart = np.sqrt(squared_distances(pool, others).min(axis=1) / len(planned))
    return np.asarray(pool[np.argmax(apart + penalty.safety(pool))])
