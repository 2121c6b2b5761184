"""Find when things happen in a maneuver of two experiments, and where both differ."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.panels import PanelCurves, Plot, drawn

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
    held = [panel.held for panel in panels]
    a, b = (_on(t, drawn(panels, run), held, run.t) for run in (left, right))
    responses = [i for i, steps in enumerate(held) if not steps]
    largest = None
    for i in responses or range(len(panels)):
        apart = np.abs(a[i] - b[i])
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
        for panel, curves, (low, high) in zip(panels, drawn(panels, run), axes["y"], strict=True)
        for moved in _movements(panel.channel, run.t, curves, _STILL * (high - low))
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


def _movements(
    channel: Channel, t: Float[np.ndarray, " K"], curves: PanelCurves, still: float
) -> list[Range]:
    """Return from when until when the curves of a panel move by more than `still`."""
    if channel.target is not None and channel.band:
        still = min(still, channel.band)
    found = []
    for values in curves:
        if values is None or not (known := np.isfinite(values)).any():
            continue
        at, y = t[known], values[known]
        moved, unsettled = (np.flatnonzero(np.abs(y - end) > still) for end in (y[0], y[-1]))
        if len(moved) and len(unsettled):
            begins, ends = max(moved[0] - 1, 0), min(unsettled[-1] + 1, len(at) - 1)
            found.append((float(at[begins]), float(at[ends])))
    return found


def _on(
    t: Float[np.ndarray, " M"],
    curves: Sequence[PanelCurves],
    held: Sequence[bool],
    own: Float[np.ndarray, " K"],
) -> list[Float[np.ndarray, " M"]]:
    """Return curves on `own` instants at others: the last value of an input, else between two."""
    last = np.searchsorted(own, t, side="right") - 1
    return [
        each.values[last] if steps else np.interp(t, own, each.values)
        for each, steps in zip(curves, held, strict=True)
    ]
