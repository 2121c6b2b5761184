"""Pair the maneuvers of two experiments, and find where their curves differ most."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import maneuvers_of
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.scenario import Scenario, panels_of


@dataclass(frozen=True, slots=True)
class Pair:
    """One maneuver of two experiments.

    Args:
        name: Name of the maneuver; "" if the experiments have only one.
        left: Left run; without a record if that experiment lacks this maneuver.
        right: Right run, in the same way.
        panels: What is drawn of both.
    """

    name: str
    left: Experiment
    right: Experiment
    panels: tuple[Plot, ...]


def pairs_of(scenario: Scenario, left: Experiment, right: Experiment) -> list[Pair]:
    """Return the maneuvers of two experiments in order; just one without a name if there are none.

    A run that failed without a record, or that ran before a maneuver was added, has no curves in
    the maneuvers that it lacks.
    """
    return [
        Pair(name, a, b, panels_of(scenario, a, b))
        for name, (a, b) in maneuvers_of(left, right).items()
    ]


def largest_difference(
    panels: Sequence[Plot],
    heights: Sequence[tuple[float, float]],
    left: Experiment,
    right: Experiment,
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


def _on(t: Float[np.ndarray, " M"], panel: Plot, experiment: Experiment) -> Float[np.ndarray, " M"]:
    """Return a curve at other instants: the last value of an input, else between two values."""
    values = panel.values(experiment)
    if panel.held:
        return np.asarray(values[np.searchsorted(experiment.t, t, side="right") - 1])
    return np.asarray(np.interp(t, experiment.t, values))
