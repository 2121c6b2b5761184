"""Put two runs from anywhere on the same panels, the same time axis and the same KPIs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.panels import Plot, plots_of
from prefcal_scenarios.scenario import KPI

_REFERENCE = "reference of "
"""Start of the key of the signal that holds an output's reference."""
_SECONDS = {"ms": 1e-3, "s": 1.0, "sec": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""Units of time that can be converted, in seconds."""


@dataclass(frozen=True, slots=True)
class Run:
    """A run to look at.

    Args:
        name: Name, as shown to people.
        experiment: The run.
        kpis: Titles, units and directions of its KPIs.
        about: Where it is from, and what was taken for what, in a sentence.
    """

    name: str
    experiment: Experiment
    kpis: tuple[KPI, ...] = ()
    about: str = ""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two runs on the same panels.

    Args:
        left: Left run.
        right: Right run.
        panels: Panels with the look that both share, from top to bottom.
        plots: Curve of every panel, by side; one without values where a run lacks it.
        kpis: KPIs that either run has.
        notes: What was changed to make them comparable, in sentences.
    """

    left: Run
    right: Run
    panels: tuple[Plot, ...]
    plots: tuple[tuple[Plot, ...], tuple[Plot, ...]]
    kpis: tuple[KPI, ...]
    notes: tuple[str, ...] = ()

    @property
    def sides(self) -> tuple[tuple[Run, tuple[Plot, ...]], tuple[Run, tuple[Plot, ...]]]:
        """Return both runs, each with its curves."""
        return (self.left, self.plots[0]), (self.right, self.plots[1])


def paired(left: Run, right: Run, *, align: bool | None = None) -> Pair:
    """Return two runs on the same panels.

    Curves share a panel if name and unit are equal; a curve that only one run has gets a panel,
    too. The right run's times are converted to the unit of the left one.

    Args:
        left: Left run.
        right: Right run.
        align: Whether both start at 0; None to do so only if their times do not overlap.
    """
    right, notes = _in_unit_of(left, right)
    starts = [run.experiment.t[0] if len(run.experiment.t) else 0.0 for run in (left, right)]
    if align or (align is None and _apart(left.experiment, right.experiment)):
        left, right = (
            replace(run, experiment=_shifted(run.experiment, -float(start)))
            for run, start in zip((left, right), starts, strict=True)
        )
        if any(starts):
            notes = (*notes, "Both runs start at 0 here: their own times are left out.")
    found = [_curves(run.experiment) for run in (left, right)]
    panels, plots = _shared(*found, fixed=_same_targets(left.experiment, right.experiment))
    sides = [replace(run, experiment=_with_references(run.experiment)) for run in (left, right)]
    kpis = {kpi.name: kpi for run in (right, left) for kpi in run.kpis}
    order = dict.fromkeys(kpi.name for run in (left, right) for kpi in run.kpis)
    return Pair(*sides, panels, plots, tuple(kpis[name] for name in order), notes)


def _in_unit_of(left: Run, right: Run) -> tuple[Run, tuple[str, ...]]:
    """Return the right run with its times in the unit of the left one, and what to say of it."""
    wanted, given = (run.experiment.channels.time_unit for run in (left, right))
    if wanted == given or not wanted or not given:
        return right, ()
    if wanted not in _SECONDS or given not in _SECONDS:
        words = f"The times of {left.name} are in {wanted}, those of {right.name} in {given}."
        return right, (words,)
    converted = in_time_unit(right.experiment, wanted)
    words = f"The times of {right.name} are converted from {given} to {wanted}; its KPIs are not."
    return replace(right, experiment=converted), (words,)


def in_time_unit(experiment: Experiment, unit: str) -> Experiment:
    """Return `experiment` with its times converted to `unit`; unchanged if that is impossible."""
    given = experiment.channels.time_unit
    if given == unit or given not in _SECONDS or unit not in _SECONDS:
        return experiment
    factor = _SECONDS[given] / _SECONDS[unit]
    return replace(
        experiment,
        t=factor * experiment.t,
        t_control=factor * experiment.t_control,
        channels=replace(experiment.channels, time_unit=unit),
        runs=tuple(in_time_unit(run, unit) for run in experiment.runs),
    )


def _shifted(experiment: Experiment, by: float) -> Experiment:
    runs = tuple(_shifted(run, by) for run in experiment.runs)
    return replace(
        experiment, t=experiment.t + by, t_control=experiment.t_control + by, runs=runs
    )  # fmt: skip


def _apart(left: Experiment, right: Experiment) -> bool:
    """Return whether the times of two runs do not overlap."""
    if not (len(left.t) and len(right.t)):
        return False
    return bool(left.t[-1] < right.t[0] or right.t[-1] < left.t[0])


_Key = tuple[str, str, int]
"""Name and unit of a curve, and its position among those of the same name and unit."""


def _curves(experiment: Experiment) -> dict[_Key, Plot]:
    """Return the curves of a run by name and unit: inputs last."""
    found: dict[_Key, Plot] = {}
    for plot in sorted(plots_of(experiment.channels), key=lambda plot: plot.held):
        name, unit, nth = plot.channel.name, plot.channel.unit, 0
        while (name, unit, nth) in found:
            nth += 1
        found[name, unit, nth] = plot
    return found


def _shared(
    left: dict[_Key, Plot], right: dict[_Key, Plot], fixed: frozenset[str]
) -> tuple[tuple[Plot, ...], tuple[tuple[Plot, ...], tuple[Plot, ...]]]:
    """Return the panels of two runs, and each run's curve of every panel."""
    keys = sorted({**left, **right}, key=lambda key: (left.get(key) or right[key]).held)
    panels, sides = [], ([], [])
    for key in keys:
        own = [side.get(key) for side in (left, right)]
        known = [plot for plot in own if plot is not None]
        looks = [plot.channel for plot in known]
        panel = replace(known[0], channel=_look(looks, keeps_target=looks[0].name in fixed))
        panel = replace(panel, reference="" if panel.channel.target is not None else _key(panel))
        panels.append(panel)
        for side, plot in zip(sides, own, strict=True):
            absent = Plot(panel.channel, "signal", "")
            side.append(absent if plot is None else replace(
                plot, channel=panel.channel, reference=panel.reference))  # fmt: skip
    return tuple(panels), (tuple(sides[0]), tuple(sides[1]))


def _key(panel: Plot) -> str:
    return _REFERENCE + panel.name


def _look(channels: Sequence[Channel], *, keeps_target: bool) -> Channel:
    """Return what the channels of both runs agree on."""
    first, last = channels[0], channels[-1]
    look = replace(
        first,
        low=first.low if first.low == last.low else -np.inf,
        high=first.high if first.high == last.high else np.inf,
        band=first.band if first.band == last.band else None,
    )
    same = first.target == last.target and keeps_target
    return look if same else replace(look, target=None, band=None)


def _same_targets(*experiments: Experiment) -> frozenset[str]:
    """Return the names of the channels that are not tracked, or whose reference is the target."""
    moving = {
        name
        for experiment in experiments
        for name, reference in _references(experiment)
        if not np.array_equal(reference, np.full_like(reference, _target(experiment, name)))
    }
    channels = [c for e in experiments for c in (*e.channels.x, *e.channels.u, *e.channels.y)]
    return frozenset(c.name for c in channels) - moving


def _target(experiment: Experiment, name: str) -> float:
    targets = [c.target for c in experiment.channels.y if c.name == name]
    return np.nan if not targets or targets[0] is None else targets[0]


def _references(experiment: Experiment) -> Iterator[tuple[str, Float[np.ndarray, " N"]]]:
    """Yield name and reference of each output that has one, at the sampling instants."""
    for j, channel in enumerate(experiment.channels.y):
        reference = experiment.y_ref[:, j]
        if len(reference) and np.isfinite(reference).any():
            yield channel.name, reference


def _with_references(experiment: Experiment) -> Experiment:
    """Return `experiment` with the reference of each output as a signal."""
    held = np.searchsorted(experiment.t_control, experiment.t, side="right") - 1
    drawn = {
        _REFERENCE + name: reference[np.maximum(held, 0)]
        for name, reference in _references(experiment)
    }
    if not drawn:
        return experiment
    runs = tuple(_with_references(run) for run in experiment.runs)
    return replace(experiment, signals={**experiment.signals, **drawn}, runs=runs)
