"""Compute KPIs of any run and say their units: tracking errors, or the range of a curve."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.kpi import KPI
from prefcal_env.experiments.maneuvers import MEAN, combined, named
from prefcal_env.experiments.tracking import BAND, band_of, entered, every_tracking_kpi, tracking_kpis

_KINDS = (
    "settling time",
    "overshoot",
    "integrated error",
    "final error",
    "late error",
    "total move",
    "largest move",
    "RMS move",
)
"""Kinds of tracking KPIs, the most telling ones first."""
_SURE = 5.0
"""Standard deviations of a median over many values that fit into the band."""
_LONGEST = 10
"""Largest number of samples of a median: the record by this number."""
_FEW, _OPPOSITE = 40, -1 / 3
"""Number of samples, and correlation of neighbors, from which noise can be told."""
_NORMAL = 1.4826
"""Standard deviation of normal noise, by the median of its size."""


def measured_run(experiment: Experiment) -> tuple[Experiment, tuple[KPI, ...]]:
    """Return `experiment` with KPIs of its own, and what they mean.

    Outputs with a reference and inputs have those of `tracking_kpis`. An output without a
    reference has its mean, its standard deviation and its range, none of which is better or worse.
    Several maneuvers have them each, and the worst and the mean of those that can be worse.
    """
    if not any(run.maneuver for run in experiment.runs):
        return _measured(experiment)
    each = [_measured(run) for run in experiment.runs]
    known = {kpi.name: kpi for _, kpis in each for kpi in kpis}
    whole = combined([run for run, _ in each])
    neither = [name for name, kpi in known.items() if kpi.goal is None]
    left_out = {*neither, *(named(name, MEAN) for name in neither)}
    values = {name: value for name, value in whole.kpis.items() if name not in left_out}
    return whole.with_kpis(values), tuple(known.values())


def _measured(experiment: Experiment) -> tuple[Experiment, tuple[KPI, ...]]:
    """Return a single run with its KPIs, and what they mean."""
    values = tracking_kpis(experiment)
    kpis = _tracking(experiment, values)
    for j, channel in enumerate(experiment.channels.y):
        if (name := f"settling time of {channel.name}") in values:
            values[name] = _settling_time(experiment, j)
            kpis = [_within_band(kpi, channel) if kpi.name == name else kpi for kpi in kpis]
    for j, channel in enumerate(experiment.channels.y):
        y = experiment.output(j)
        if y is None or f"integrated error of {channel.name}" in values:
            continue
        for words, value, about in _statistics(experiment.t, y):
            name = f"{words} of {channel.name}"
            values[name] = value
            kpis.append(KPI(name, name, channel.unit, about=about))
    return experiment.with_kpis(values), tuple(kpis)


def _settling_time(experiment: Experiment, j: int) -> float:
    """Return when output `j` entered its band for good; noise that leaves it does not count.

    It is that of the running median over so many samples that noise stays in the band.
    """
    y = np.asarray(experiment.output(j))
    t, error = experiment.t - experiment.t[0], y - experiment.reference(j)
    band = band_of(experiment.channels.y[j], error)
    wanted = (_SURE * _noise(t, y) / band) ** 2 if band > 0 else 0.0
    half = int(min(wanted, len(t) / _LONGEST)) // 2
    if half:
        padded = np.pad(error, half, mode="reflect")
        error = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    return entered(t, error, band)


def _noise(t: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"]) -> float:
    """Return the standard deviation of noise, from each value's distance to the line beside it.

    Of the second half, where the transient is over. An oscillation is no noise: such distances of
    neighbors are alike there, and opposite in noise (their correlation is -2/3).
    """
    if len(t) < _FEW:
        return 0.0
    t, y = t[len(t) // 2 :], y[len(t) // 2 :]
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    line = (1 - share) * y[:-2] + share * y[2:]
    size = np.sqrt(1 + share**2 + (1 - share) ** 2)
    apart = (y[1:-1] - line) / size
    opposite = apart[1:] @ apart[:-1] < _OPPOSITE * (apart @ apart)
    return float(_NORMAL * np.median(np.abs(apart))) if opposite else 0.0


def _within_band(kpi: KPI, channel: Channel) -> KPI:
    """Return the KPI of a settling time with its band in the title."""
    given = channel.band is not None
    band = f"{channel.band:g} {channel.unit}".rstrip() if given else f"{100 * BAND:g} %"
    of = "" if given else ", a share of the largest error"
    about = f"{kpi.about} The band is ±{band}{of}; noise that leaves it does not count."
    return replace(kpi, title=f"{kpi.title} (±{band})", about=about)


def _tracking(experiment: Experiment, values: Mapping[str, float]) -> list[KPI]:
    """Return what each of the tracking KPIs in `values` means."""
    every = every_tracking_kpi(experiment.channels)
    names = sorted(every, key=lambda name: _KINDS.index(name.partition(" of ")[0]))
    return [every[name] for name in names if name in values]


def _statistics(t: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"]) -> Iterator[tuple[str, float, str]]:
    """Yield name, value and meaning of what describes a curve; gaps are left out."""
    there = np.isfinite(y)
    if not there.any():
        return
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
