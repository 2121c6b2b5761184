"""Compute KPIs of any run and say their units: tracking errors, or the range of a curve."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_scenarios.scenario import KPI

_ABOUT = {
    "integrated error": "Integral of the absolute distance from the reference.",
    "late error": "Integral of time times the absolute distance from the reference.",
    "settling time": "Time after which the output stays close to its reference.",
    "overshoot": "How far the output goes beyond its reference.",
    "final error": "Distance from the reference at the end.",
    "total move": "Sum of all changes of the input.",
    "largest move": "Largest change of the input in a step.",
    "RMS move": "Root mean square of the changes of the input.",
}
"""What the KPIs of `tracking_kpis` mean, by their first words."""


def measured_run(experiment: Experiment) -> tuple[Experiment, tuple[KPI, ...]]:
    """Return `experiment` with KPIs of its own, and what they mean.

    Outputs with a reference and inputs have those of `tracking_kpis`. An output without a
    reference has its mean, its standard deviation and its range, none of which is better or worse.
    """
    values = tracking_kpis(experiment)
    kpis = [kpi for kpi in _tracking(experiment) if kpi.name in values]
    for channel, y in _untracked(experiment, values):
        for words, value, about in _statistics(experiment.t, y):
            name = f"{words} of {channel.name}"
            values[name] = value
            kpis.append(KPI(name, name, channel.unit, about=about))
    return experiment.with_kpis(values), tuple(kpis)


def _tracking(experiment: Experiment) -> Iterator[KPI]:
    """Yield what each KPI of `tracking_kpis` means, the most telling first."""
    time = experiment.channels.time_unit
    of_outputs = {
        "settling time": "{t}", "overshoot": "{u}", "integrated error": "{u} {t}",
        "final error": "{u}", "late error": "{u} {t}²",
    }  # fmt: skip
    for kinds, channels in (
        (of_outputs, experiment.channels.y),
        (dict.fromkeys(("total move", "largest move", "RMS move"), "{u}"), experiment.channels.u),
    ):
        for kind, unit in kinds.items():
            for channel in channels:
                name = f"{kind} of {channel.name}"
                of = unit.format(u=channel.unit, t=time).strip()
                yield KPI(name, name, of, better="lower", about=_ABOUT[kind])


def _untracked(
    experiment: Experiment, known: dict[str, float]
) -> Iterator[tuple[Channel, Float[np.ndarray, " K"]]]:
    """Yield the outputs without tracking KPIs, with their values."""
    for j, channel in enumerate(experiment.channels.y):
        y = experiment.output(j)
        if f"integrated error of {channel.name}" in known or y is None:
            continue
        if np.isfinite(y).any():
            yield channel, np.asarray(y)


def _statistics(
    t: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"]
) -> Iterator[tuple[str, float, str]]:
    """Yield name, value and meaning of what describes a curve; gaps are left out."""
    there = np.isfinite(y)
    t, y = t[there], y[there]
    # A value counts for half of the time to each of its neighbors, as in the trapezoidal rule.
    steps = np.diff(t)
    weights = np.append(steps, 0.0) + np.append(0.0, steps) if len(t) > 1 else np.ones(1)
    mean = float(np.average(y, weights=weights))
    spread = float(np.sqrt(np.average((y - mean) ** 2, weights=weights)))
    yield "mean", mean, "Mean over time."
    yield "standard deviation", spread, "Standard deviation over time."
    yield "lowest", float(y.min()), "Smallest value."
    yield "highest", float(y.max()), "Largest value."
