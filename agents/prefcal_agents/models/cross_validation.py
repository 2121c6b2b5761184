"""Choose the shape of φ by K-fold cross-validation on the preferences themselves.

Source: end of the section "Training a surrogate function from preferences" of the paper.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from prefcal_agents.history.lessons import Preferences

from .preference_qp import Learning, fits_without
from .rbf import Shape

FOLDS = 3
"""K of the cross-validation, as in section IV of the paper."""


@dataclass(frozen=True, slots=True)
class Validation:
    """Comparisons split into K slices, each left out once; all samples stay centers.

    Args:
        preferences: M comparisons.
        learning: How β is learned from the rest.
        slices: Which comparisons each of the K slices holds, shape (K, M).
    """

    preferences: Preferences
    learning: Learning
    slices: Bool[np.ndarray, "K M"]

    @classmethod
    def deal(cls, preferences: Preferences, learning: Learning, rng: np.random.Generator) -> "Validation":
        """Split at random into `FOLDS` slices, whose sizes differ by at most one comparison."""
        share = rng.permutation(len(preferences)) % FOLDS
        return cls(preferences, learning, share == np.arange(FOLDS)[:, None])

    def reproduced(self, shape: Shape, epsilons: Sequence[float]) -> list[int]:
        """Return how many left-out preferences `shape` predicts right with each ε."""
        known = self.preferences
        bases = shape.bases(known.samples, known.samples, epsilons)
        betas = fits_without(known, bases, self.slices, self.learning)
        return [self._right(phi, each) for phi, each in zip(bases, betas, strict=True)]

    def _right(self, phi: Float[np.ndarray, "N N"], betas: Sequence[Float[np.ndarray, " N"]]) -> int:
        known, right = self.preferences, 0
        for left_out, beta in zip(self.slices, betas, strict=True):
            values = phi @ beta
            gap = values[known.first[left_out]] - values[known.second[left_out]]
            b = known.b[left_out]
            agrees = np.where(b == 0, np.abs(gap) <= self.learning.sigma, b * gap > 0)
            right += int(np.count_nonzero(agrees))
        return right


def choose_epsilon(validation: Validation, shape: Shape, candidates: Sequence[float]) -> tuple[Shape, int]:
    """Return `shape` with the best ε of `candidates`, and how many preferences it reproduces.

    Among equally good ones (with a few dozen answers there are many), take the middle one.
    """
    scores = validation.reproduced(shape, candidates)
    best = max(scores)
    winners = [e for e, score in zip(candidates, scores, strict=True) if score == best]
    return replace(shape, epsilon=winners[len(winners) // 2]), best


def nearest(candidates: Sequence[float], epsilon: float, reach: int) -> Sequence[float]:
    """Return the candidate next to `epsilon`, and up to `reach` of them on either side."""
    middle = int(np.argmin(np.abs(np.log(np.array(candidates) / epsilon))))
    return candidates[max(middle - reach, 0) : middle + reach + 1]


def rescale_knob(
    shape: Shape, score: float, knob: int, judge: Callable[[Shape], tuple[Shape, float]]
) -> Shape:
    """Return `shape`, with `knob` counting twice or half as much if that is clearly better.

    Source: none.
    Deviation: the paper has one ε for all knobs.

    Args:
        shape: Shape in use; with a single knob, it stays.
        score: How well it predicts: a gain of 1 (one comparison, or one nat) may be chance.
        knob: Index of the knob.
        judge: Function that returns the best one of similar shapes, and its score.
    """
    for factor in (2.0, 0.5) if len(shape.scales) > 1 else ():
        changed = shape.rescaled(knob, factor)
        if changed is not None:
            better, found = judge(changed)
            if found > score + 1:
                shape, score = better, found
    return shape
