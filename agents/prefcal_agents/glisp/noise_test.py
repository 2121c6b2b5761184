"""Test whether some answers are wrong, and choose the shape of φ that suits such answers."""

from dataclasses import dataclass, replace

import numpy as np

from prefcal_agents.history.lessons import Preferences
from prefcal_agents.models.cross_validation import nearest, rescale_knob
from prefcal_agents.models.gaussian_process import ExpectationPropagation, Sites
from prefcal_agents.models.preference_qp import Constraints
from prefcal_agents.models.rbf import Shape

MANY = 100
"""Number of experiments or comparisons from which on choosing the shape of φ is slow and hardly
changes it."""
ALMOST_SURE = 0.003
"""Error rate of a person who is hardly ever wrong. With 0, possibly no surrogate would fit."""
WINDOW = 10
"""Number of tests to average, since a cost that jumps looks like mistakes for a while. With a
single test, calibrators of the reactor who are never wrong often counted as noisy, which cost
experiments."""
_ENOUGH = 1.0
"""Minimum gain in log probability that counts as a difference, in nats."""
_EPSILONS = (0.32, 0.56, 1.0, 1.8, 3.2, 5.6)


@dataclass(frozen=True, slots=True)
class NoiseTest:
    """Result of comparing two explanations of the answers: some are wrong, or none are.

    Args:
        shape: Shape of φ that predicts the answers of a fallible person best.
        evidence: Mean of the latest log likelihood ratios (nats); above 0 speaks for mistakes.
    """

    shape: Shape
    evidence: float

    @property
    def suspects(self) -> bool:
        """Return whether mistakes are much more likely than none."""
        return self.evidence > _ENOUGH


def evidence_of_mistakes(preferences: Preferences, shape: Shape, error_rate: float) -> float:
    """Return the log likelihood ratio (nats) of a fallible person to one who is never wrong.

    Each answer is predicted from all others.
    """
    if not np.any(preferences.b):
        return 0.0
    constraints = rows_of(preferences, shape)
    fallible = ExpectationPropagation.of(constraints, error_rate)
    sure = ExpectationPropagation.of(constraints, ALMOST_SURE, fallible.sites)
    return fallible.predicted - sure.predicted


def suited_shape(
    preferences: Preferences, shape: Shape, error_rate: float, *, answered: int, first: bool
) -> Shape:
    """Return the shape next to `shape` with which a fallible person's answers are predicted best.

    ε moves to a neighbor (with `first` anywhere), and the scale of one knob by a factor of 2 (the
    knobs take turns, by the number of experiments `answered`).
    """
    if not np.any(preferences.b) or len(preferences) > MANY:
        return shape

    start: Sites | None = None

    def score(shape: Shape) -> float:
        nonlocal start  # each fit starts from the last sites, which saves a third of the time
        fit = ExpectationPropagation.of(rows_of(preferences, shape), error_rate, start)
        start = fit.sites
        return fit.predicted

    candidates = _EPSILONS if first else nearest(_EPSILONS, shape.epsilon, 1)
    best, epsilon = max((score(replace(shape, epsilon=x)), x) for x in candidates)
    turn = answered % len(shape.scales)
    suited = replace(shape, epsilon=epsilon)
    return rescale_knob(suited, best, turn, lambda changed: (changed, score(changed)))


def rows_of(preferences: Preferences, shape: Shape) -> Constraints:
    """Return comparisons as signs of rows · β."""
    features = shape.basis(preferences.samples, preferences.samples)
    return Constraints.of(preferences, features, np.ones(len(preferences.b)))
