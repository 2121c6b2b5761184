"""Find when things happen in a maneuver of two experiments, and where both differ."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Plot

from .seen import Range, snapped

_STILL = 0.02
"""Share of its axis by which a curve may move while nothing happens."""
_BEFORE, _AFTER = 0.05, 0.25
"""Shares of the time in which things happen that are shown before and after it."""
_COARSE = 3
"""Steps of the time shown, up to twice as many: a similar pair has the same time axis, and is drawn
in a tenth of the time."""
_NEARLY_ALL = 0.8
"""Share of the whole time from which all of it is shown."""


def largest_difference(
    panels: Sequence[Plot], heights: Sequence[tuple[float, float]], left: Experiment, right: Experiment
) -> dict[str, Any] | None:
    """Return where the curves of two runs differ most, relative to the axes of their panels.

    Only the time that both runs cover counts, and inputs only if nothing else is drawn: at the
    first instant of a step they differ by their full range without telling the runs apart.

    Args:
        panels: Panels of both runs.
        heights: Ends of the axis of each panel, in the panel's unit.
        left: Left run.
        right: Right run.

    Returns:
        The time `t`, the number of the `panel`, and the `size` as a share of its axis; None if
        nothing differs.
    """
    if not len(left.t) or not len(right.t):
        return None
    t = np.union1d(left.t, right.t)
    t = t[(t >= max(left.t[0], right.t[0])) & (t <= min(left.t[-1], right.t[-1]))]
    responses = [i for i, panel in enumerate(panels) if not panel.held]
    largest = None
    for i in responses or range(len(panels)):
        apart = np.abs(_on(t, panels[i], left) - _on(t, panels[i], right))
        if not np.isfinite(apart).any():
            continue
        at, (low, high) = int(np.nanargmax(apart)), heights[i]
        size = float(apart[at] / (high - low))
        if size > (0.0 if largest is None else largest["size"]):
            largest = {"t": float(f"{t[at]:.6g}"), "panel": i, "size": round(size, 4)}
    return largest


def eventful(
    panels: Sequence[Plot], axes: dict[str, Any], left: Experiment, right: Experiment
) -> list[float]:
    """Return the part of the time axis in which things happen in either of two runs.

    That is from the first time any curve, reference or limit moves until all of them stay near
    their last value: within the band of a target, and within 2 % of the axis.

    Args:
        panels: Panels of both runs.
        axes: Axes of the panels: `x`, and `y` by panel.
        left: Left run.
        right: Right run.
    """
    first, last = axes["x"]
    found = [
        moved
        for run in (*(left.runs or (left,)), *(right.runs or (right,)))
        if len(run.t)
        for panel, (low, high) in zip(panels, axes["y"], strict=True)
        for moved in _movements(panel, run, _STILL * (high - low))
    ]
    if not found:
        return [first, last]
    start, end = min(a for a, _ in found), max(b for _, b in found)
    if not start < end:
        return [first, last]
    width = end - start
    shown = snapped(start - _BEFORE * width, end + _AFTER * width, _COARSE)
    start, end = max(shown[0], first), min(shown[1], last)
    return [first, last] if end - start > _NEARLY_ALL * (last - first) else [start, end]


def _movements(panel: Plot, run: Experiment, still: float) -> list[Range]:
    """Return from when until when the values of a panel move by more than `still`."""
    channel = panel.channel
    if channel.target is not None and channel.band:
        still = min(still, channel.band)
    found = []
    for values in (panel.values(run), *panel.beside(run)):
        if values is None or not (known := np.isfinite(values)).any():
            continue
        t, y = run.t[known], values[known]
        moved, unsettled = (np.flatnonzero(np.abs(y - at) > still) for at in (y[0], y[-1]))
        if len(moved) and len(unsettled):
            begins, ends = max(moved[0] - 1, 0), min(unsettled[-1] + 1, len(t) - 1)
            found.append((float(t[begins]), float(t[ends])))
    return found


def _on(t: Float[np.ndarray, " M"], panel: Plot, experiment: Experiment) -> Float[np.ndarray, " M"]:
    """Return a curve at other instants: the last value of an input, else between two values."""
    values = panel.values(experiment)
    if panel.held:
        return np.asarray(values[np.searchsorted(experiment.t, t, side="right") - 1])
    return np.asarray(np.interp(t, experiment.t, values))
