"""Tell from the beginning of a run how good the whole run can still become.

Sums, integrals, maxima and counts can only grow while a run goes on, so what they have reached is a
lower bound of what they become. A run whose lower bounds are bad enough need not be finished.
"""

from dataclasses import replace

import numpy as np

from prefcal_env.errors import ExperimentError

from .end import End
from .experiment import Experiment
from .kpi_units import kinds_of
from .kpis import tracking_kpis

_GROWING = ("integrated error", "late error", "overshoot", "total move", "largest move")
"""Kinds of tracking KPIs that can only grow."""
_SETTLING = "settling time"


def until(experiment: Experiment, time: float) -> Experiment:
    """Return the record of `experiment` up to `time`, as if the run had been cut short there.

    Args:
        experiment: Experiment; one with several variants or maneuvers has no single record.
        time: Time in the experiment's unit. The last instant that is not later ends the record.

    Returns:
        The record, without KPIs: those of the whole run would be wrong.

    Raises:
        ExperimentError: If `experiment` has several runs, or no instant up to `time`.
    """
    if experiment.runs:
        raise ExperimentError(f"only a single run can be cut, got {len(experiment.runs)} of them")
    count = int(np.searchsorted(experiment.t, time, side="right"))
    if not count:
        raise ExperimentError(f"time must not be before the first instant, got {time:g}")
    last = experiment.t[count - 1]
    steps = max(int(np.searchsorted(experiment.t_control, last, side="left")), 1)
    kept, decided = slice(0, count), slice(0, steps)
    return replace(
        experiment,
        t=experiment.t[kept], x=experiment.x[kept], u=experiment.u[kept],
        y=None if experiment.y is None else experiment.y[kept],
        t_control=experiment.t_control[decided], u_control=experiment.u_control[decided],
        y_ref=experiment.y_ref[decided], iterations=experiment.iterations[decided],
        solve_time=experiment.solve_time[decided], solved=experiment.solved[decided],
        signals={name: values[kept] for name, values in experiment.signals.items()},
        kpis={}, end=End.CUT_SHORT,
    )  # fmt: skip


def tracking_bounds(experiment: Experiment) -> dict[str, float]:
    """Return lower bounds of the tracking KPIs of a run, from its record so far.

    The settling time is bounded only if the channel has a band: without one, the band depends on
    the largest error of the whole run. Nothing is known of the final error and of means.

    Args:
        experiment: Record of the run so far.

    Returns:
        Lower bounds by the names of `tracking_kpis`, in the same units.
    """
    known, found = tracking_kpis(experiment), dict[str, float]()
    for kind, channel in kinds_of(experiment.channels):
        name = kind.of(channel)
        if name not in known:
            continue
        if kind.name in _GROWING:
            found[name] = known[name]
        elif kind.name == _SETTLING and channel.band is not None:
            # Infinite means outside now: the entry into the band is still to come.
            found[name] = min(known[name], experiment.duration)
    return found
