"""Say whether a run kept the limits of its signals."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_scenarios.presentation.wording import number, with_unit

_NEAR = 1e-6
"""Share of its size by which a value may miss a limit and still count as being at it."""


def limits_kept(before: Experiment, after: Experiment) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, limits, and text before and after for each input and output with limits.

    An input saturates at a limit. An output is outside beyond one. Both are shares of the time;
    several runs of an experiment (maneuvers, variants) count together.
    """
    named = [(True, i, c) for i, c in enumerate(after.channels.y)]
    named = [(False, i, c) for i, c in enumerate(after.channels.u)] + named
    for output, i, channel in named:
        if limits := _limits(channel):
            old, new = (_share(e, i, channel, output=output) for e in (before, after))
            what = "outside its limits" if output else "saturated"
            yield f"{channel.name} {what}", limits, old, new


def _limits(channel: Channel) -> str:
    """Return the limits as text; empty without any."""
    low, high = np.isfinite(channel.low), np.isfinite(channel.high)
    if low and high:
        return with_unit(f"{number(channel.low)} to {number(channel.high)}", channel.unit)
    if low or high:
        sign, limit = ("≥", channel.low) if low else ("≤", channel.high)
        return f"{sign} {with_unit(number(limit), channel.unit)}"
    return ""


def _share(experiment: Experiment, i: int, channel: Channel, *, output: bool) -> str:
    """Return the share of the time as text; a dash if the signal was not recorded."""
    there = total = 0.0
    for run in experiment.runs or (experiment,):
        values = run.output(i) if output else run.u[:, i] if len(run.t) else None
        if values is None or len(run.t) < 2:
            continue
        steps = np.diff(run.t)  # values are held until the next instant
        there += float(steps[_is_there(values[:-1], channel, output=output)].sum())
        total += float(steps.sum())
    if not total:
        return "–"
    if not there:
        return "never"
    percent = 100 * there / total
    return (
        f"{number(round(percent, 1))} % of the time" if percent >= 0.05 else "< 0.1 % of the time"
    )


def _is_there(
    values: Float[np.ndarray, " K"], channel: Channel, *, output: bool
) -> Bool[np.ndarray, " K"]:
    """Return where an input is at a limit, or an output beyond one."""
    ends = [limit for limit in (channel.low, channel.high) if np.isfinite(limit)]
    near = _NEAR * max(map(abs, (*ends, 1e-300)))
    margin = near if output else -near
    outside: Bool[np.ndarray, " K"] = (values < channel.low - margin) | (
        values > channel.high + margin
    )
    return outside
