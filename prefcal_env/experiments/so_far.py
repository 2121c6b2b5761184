"""Tell from the beginning of a run how good the whole run can still become.

Sums, integrals, maxima and counts can only grow while a run goes on, so what they have reached is a
lower bound of what they become. A run whose lower bounds are bad enough need not be finished.
"""

from dataclasses import replace

import numpy as np

from prefcal_env.errors import ExperimentError

from .end import End
from .experiment import Experiment
from .kpi_units import OF_INPUT, OF_OUTPUT
from .kpis import tracking_kpis

_GROWING = ("integrated error", "late error", "overshoot", "total move", "largest move")
"""Kinds of tracking KPIs that can only grow."""
_SETTLING, _RMS = "settling time", "RMS move"


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


def tracking_bounds(experiment: Experiment, longest: float) -> dict[str, float]:
    """Return lower bounds of the tracking KPIs of a run, from its record so far.

    The settling time is bounded only if the channel has a band: without one, the band depends on
    the largest error of the whole run. Nothing is known of the final error.

    Args:
        experiment: Record of the run so far, with constant references.
        longest: Longest duration of a whole run, in the experiment's unit of time; the root mean
            square of the moves is bounded as if all later moves were 0.

    Returns:
        Lower bounds by the names of `tracking_kpis`, in the same units.
    """
    known, found = tracking_kpis(experiment), dict[str, float]()
    for channel in experiment.channels.y:
        found |= {k.of(channel): known[k.of(channel)]
                  for k in OF_OUTPUT if k.name in _GROWING and k.of(channel) in known}  # fmt: skip
        settling = f"{_SETTLING} of {channel.name}"
        if channel.band is not None and settling in known:
            # Infinite means outside now: the entry into the band is still to come.
            found[settling] = min(known[settling], experiment.duration)
    passed = min(experiment.duration / longest, 1.0)
    for channel in experiment.channels.u:
        found |= {k.of(channel): known[k.of(channel)]
                  for k in OF_INPUT if k.name in _GROWING and k.of(channel) in known}  # fmt: skip
        name = f"{_RMS} of {channel.name}"
        if name in known:
            found[name] = known[name] * float(np.sqrt(passed))
    return found
