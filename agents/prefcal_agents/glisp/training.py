"""Train Ĵ on the data in a history."""

from prefcal_agents.models.gaussian_process import ExpectationPropagation
from prefcal_agents.models.preference_qp import Constraints, Learning, fit, margins
from prefcal_agents.models.rbf import Surrogate

from .noise_test import rows_of
from .selection import Dataset, Selection
from .settings import GLISpSettings


def train(data: Dataset, selection: Selection, settings: GLISpSettings) -> Surrogate:
    """Return Ĵ, trained on `data` with the selected shape and weights.

    Source: eq. QP-pref.
    Deviation: if answers may be wrong (`is_noisy`), Ĵ need not reproduce all; see
    `ExpectationPropagation`.
    """
    if selection.is_noisy:
        assert selection.noise is not None
        shape, posterior = selection.noise.shape, trust(data, selection, settings.error_rate)
        return Surrogate(data.preferences.samples, posterior.mean, shape)
    preferences, shape = data.preferences, selection.shape
    margin = margins(preferences, settings.margin_power)
    features = shape.basis(preferences.samples, preferences.samples)
    constraints = Constraints.of(preferences, features, margin)
    v = fit(constraints, Learning(margin_power=settings.margin_power))
    return Surrogate(preferences.samples, v, shape)


def trust(data: Dataset, selection: Selection, error_rate: float) -> ExpectationPropagation:
    """Return the posterior of β if each answer is wrong with probability `error_rate`."""
    assert selection.noise is not None
    rows = rows_of(data.preferences, selection.noise.shape)
    return ExpectationPropagation.of(rows, error_rate)
