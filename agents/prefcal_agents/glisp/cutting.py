"""Whether a run in progress can still win, given what was learned from KPIs."""

from collections.abc import Mapping

import numpy as np

from prefcal_agents.utility.explained import AFTER
from prefcal_env.preferences.history import History

from .kpi_fit import KPIFit

HOPELESS = 0.01
"""Chance to win below which a run is cut short."""


def chance_to_win(fit: KPIFit | None, history: History, bounds: Mapping[str, float]) -> float:
    """Return the probability that a run can still become the best; 1 while too little is known.

    It is the share of the draws of what the person wants in which the cost at the lower bounds of
    the KPIs is below the cost of the best experiment. In each draw the cost only grows with the
    KPIs, so what the run becomes costs at least as much. Forecasts of the KPIs end more runs, but
    wrongly: docs/research/archive.md.

    Source: none.
    Deviation: the paper finishes every run.

    Args:
        fit: What was learned from KPIs; None if they do not explain the answers.
        history: Samples and answers. Ten answers are needed, those about runs that were cut short
            not counted, and a best experiment that was neither cut short nor unsafe.
        bounds: Lower bounds of the run's KPIs by name, lower is better. A KPI without a bound
            counts as the best value that a cost can tell apart.

    Returns:
        The probability, from 0 to 1.
    """
    best, cut = history.incumbent, history.cut_short()
    if fit is None or best is None or best in cut | history.unsafe():
        return 1.0
    if sum(not cut & {c.challenger, c.incumbent} for c in history.lessons()) < AFTER:
        return 1.0
    scale = fit.scale
    lowest = np.array([bounds.get(name, -np.inf) for name in scale.names])
    reached = np.log(np.maximum(lowest - scale.good, scale.floor))
    rival = scale(fit.bank, [fit.bank.find(history.samples[best].theta)])
    costs = fit.utilities.costs(np.vstack([reached, rival]))
    return float(np.mean(costs[:, 0] < costs[:, 1]))
