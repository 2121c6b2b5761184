"""Choose the shape of φ by K-fold cross-validation on the preferences themselves.

Source: end of the section "Training a surrogate function from preferences" of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from prefcal_agents.history.lessons import Preferences
from prefcal_env.qp import Backend

from .preference_qp import Constraints, Learning, fit_without, margins
from .rbf import Shape

FOLDS = 3
"""K of the cross-validation, as in section IV of the paper."""
GAIN = 2  # comparisons that a change of scale must win: one more is often chance


@dataclass(frozen=True, slots=True)
class Validation:
    """Comparisons dealt out to K slices, each left out once; all samples stay centers.

    Args:
        preferences: M comparisons.
        learning: How β is learned from the rest.
        backend: QP solver.
        slices: Which comparisons each of the K slices holds, shape (K, M).
        margin: Margin of each comparison, shape (M,), see `margins`.
    """

    preferences: Preferences
    learning: Learning
    backend: Backend
    slices: Bool[np.ndarray, "K M"]
    margin: Float[np.ndarray, " M"]

    @classmethod
    def deal(
        cls,
        preferences: Preferences,
        learning: Learning,
        backend: Backend,
        rng: np.random.Generator,
    ) -> "Validation":
        """Deal at random, to `FOLDS` slices that differ by at most one comparison."""
        share = rng.permutation(len(preferences)) % FOLDS
        margin = margins(preferences, learning.margin_power)
        return cls(preferences, learning, backend, share == np.arange(FOLDS)[:, None], margin)

    def reproduced(self, shape: Shape, columns: Float[np.ndarray, "N p"] | None = None) -> int:
        """Return how many left-out preferences are predicted right (eq. RBF-pref).

        `columns` are KPIs of the samples that may explain them too, shape (N, p).
        """
        known = self.preferences
        phi = shape.basis(known.samples, known.samples)
        constraints = Constraints.of(known, phi, self.margin)
        if columns is not None:
            constraints = constraints.with_outcomes(known, columns)
            phi = np.hstack([phi, columns])
        right = 0
        betas = fit_without(constraints, self.slices, self.learning, self.backend)
        for left_out, beta in zip(self.slices, betas, strict=True):
            values = phi @ beta
            gap = values[known.first[left_out]] - values[known.second[left_out]]
            b = known.b[left_out]
            agrees = np.where(b == 0, np.abs(gap) <= self.learning.sigma, b * gap > 0)
            right += int(np.count_nonzero(agrees))
        return right

    def choose(self, shapes: Sequence[Shape]) -> tuple[Shape, int]:
        """Return the shape that reproduces most preferences, and how many that is.

        Among equally good ones (a few dozen answers leave many) the middle one is taken.
        """
        scores = [self.reproduced(shape) for shape in shapes]
        best = max(scores)
        winners = [s for s, score in zip(shapes, scores, strict=True) if score == best]
        return winners[len(winners) // 2], best


def choose_epsilon(
    validation: Validation, shape: Shape, candidates: Sequence[float]
) -> tuple[Shape, int]:
    """Return `shape` with the best ε of `candidates`, and how many preferences it reproduces."""
    return validation.choose([replace(shape, epsilon=epsilon) for epsilon in candidates])


def nearest(candidates: Sequence[float], epsilon: float, reach: int) -> Sequence[float]:
    """Return the candidate next to `epsilon`, and up to `reach` of them on either side."""
    middle = int(np.argmin(np.abs(np.log(np.array(candidates) / epsilon))))
    return candidates[max(middle - reach, 0) : middle + reach + 1]


def rescale_knob(
    validation: Validation,
    shape: Shape,
    score: int,
    candidates: Sequence[float],
    *,
    knob: int,
    widest: float = 16.0,
) -> Shape:
    """Return `shape`, with `knob` counting twice or half as much if that is clearly better.

    Source: none.
    Deviation: the paper has one ε for all knobs.

    Args:
        validation: Slices to score with.
        shape: In use, reproducing `score` of the preferences.
        score: See there.
        candidates: Values of ε, increasing; those next to the one in use are tried again.
        knob: Index of the knob.
        widest: Largest ratio between the scales of two knobs.
    """
    around, best = nearest(candidates, shape.epsilon, 1), shape
    for factor in (2.0, 0.5):
        scales = _scaled(best.scales, knob, factor)
        if scales.max() > widest * scales.min():
            continue
        rescaled = replace(best, scales=tuple(map(float, scales)))
        challenger, reproduced = choose_epsilon(validation, rescaled, around)
        if reproduced >= score + GAIN:
            best, score = challenger, reproduced
    return best


def _scaled(scales: tuple[float, ...], knob: int, factor: float) -> Float[np.ndarray, " n"]:
    changed = np.array(scales)
    changed[knob] *= factor
    return np.asarray(changed / np.exp(np.mean(np.log(changed))))
