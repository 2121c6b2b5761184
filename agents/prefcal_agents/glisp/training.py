"""Train Ĵ on the data in a history."""

import numpy as np
from jaxtyping import Float

from prefcal_agents.models.gaussian_process import ExpectationPropagation
from prefcal_agents.models.kpi_model import Composite, KPIModel
from prefcal_agents.models.preference_qp import Constraints, Learning, fit, margins
from prefcal_agents.models.rbf import Shape, Surrogate
from prefcal_env.qp import Backend

from .noise_test import rows_of
from .selection import Dataset, Selection
from .settings import GLISpSettings


def train(
    data: Dataset, selection: Selection, settings: GLISpSettings, backend: Backend
) -> Surrogate | Composite:
    """Return Ĵ, trained on `data` with the selected shape and weights.

    Source: eq. QP-pref.
    Deviation: KPIs that explain the answers are part of Ĵ if cross-validation finds that they
    help to predict answers. If answers may be wrong (`is_noisy`), Ĵ need not reproduce all;
    see `ExpectationPropagation`.
    """
    if selection.is_noisy:
        assert selection.noise is not None
        shape, posterior = selection.noise.shape, trust(data, selection, settings.error_rate)
        return assembled(data, selection, shape, posterior.mean)
    preferences, shape = data.preferences, selection.shape
    margin = margins(preferences, settings.margin_power)
    features = shape.basis(preferences.samples, preferences.samples)
    constraints = Constraints.of(preferences, features, margin)
    columns = data.columns(selection.kpi_scale)
    if columns is not None:
        constraints = constraints.with_outcomes(preferences, columns)
    v = fit(constraints, Learning(margin_power=settings.margin_power), backend)
    return assembled(data, selection, shape, v)


def trust(data: Dataset, selection: Selection, error_rate: float) -> ExpectationPropagation:
    """Return the posterior of β if each answer is wrong with probability `error_rate`."""
    assert selection.noise is not None
    columns = data.columns(selection.kpi_scale)
    return ExpectationPropagation.of(
        rows_of(data.preferences, selection.noise.shape, columns), error_rate
    )


def assembled(
    data: Dataset, selection: Selection, shape: Shape, v: Float[np.ndarray, " P"]
) -> Surrogate | Composite:
    """Return Ĵ of the coefficients `v`: of the N features, then of the KPIs that count."""
    samples, scale = data.preferences.samples, selection.kpi_scale
    surrogate = Surrogate(samples, v[: len(samples)], shape)
    if data.kpis is None or scale == 0:
        return surrogate
    return Composite(surrogate, KPIModel(data.kpis, scale * np.maximum(v[len(samples) :], 0.0)))
