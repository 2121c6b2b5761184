"""Put two runs from anywhere on the same panels, the same time axis and the same KPIs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.experiments.maneuvers import by_maneuver, combined
from prefcal_env.experiments.panels import Plot, plots_of
from prefcal_env.tables.units import SECONDS
from prefcal_scenarios.scenario import KPI

from .units import in_time_unit


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
    """Two runs with the same channels, so that one set of panels draws both.

    Args:
        left: Left run.
        right: Right run.
        panels: Panels from top to bottom; a run that lacks a curve has no values there.
        kpis: KPIs that either run has.
        notes: What was changed to make them comparable, in sentences.
    """

    left: Run
    right: Run
    panels: tuple[Plot, ...]
    kpis: tuple[KPI, ...]
    notes: tuple[str, ...] = ()


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
    left, right = _with_maneuvers_of(left, right), _with_maneuvers_of(right, left)
    starts = [run.experiment.t[0] if len(run.experiment.t) else 0.0 for run in (left, right)]
    if align or (align is None and _apart(left.experiment, right.experiment)):
        left, right = (
            replace(run, experiment=_shifted(run.experiment, -float(start)))
            for run, start in zip((left, right), starts, strict=True)
        )
        if any(starts):
            notes = (*notes, "Both runs start at 0 here: their own times are left out.")
    right = _with_other_kpis(right, left)
    kpis = {kpi.name: kpi for run in (left, right) for kpi in run.kpis}
    layout = _Layout.of(left.experiment, right.experiment)
    left, right = (
        replace(run, experiment=layout.applied(run.experiment)) for run in (left, right)
    )  # fmt: skip
    return Pair(left, right, layout.panels, tuple(kpis.values()), notes)


def _in_unit_of(left: Run, right: Run) -> tuple[Run, tuple[str, ...]]:
    """Return the right run with its times in the unit of the left one, and what to say of it."""
    wanted, given = (run.experiment.channels.time_unit for run in (left, right))
    if wanted == given or not wanted or not given:
        return right, ()
    if wanted not in SECONDS or given not in SECONDS:
        words = f"The times of {left.name} are in {wanted}, those of {right.name} in {given}."
        return right, (words,)
    experiment, kpis = in_time_unit(right.experiment, right.kpis, wanted)
    words = f"The times of {right.name} are converted from {given} to {wanted}."
    return replace(right, experiment=experiment, kpis=kpis), (words,)


def _with_maneuvers_of(run: Run, other: Run) -> Run:
    """Return `run` as one that does the same in each maneuver of the other one, if it has none."""
    names = [name for name in by_maneuver(other.experiment) if name]
    if not names or "" not in by_maneuver(run.experiment):
        return run
    alone = replace(run.experiment, runs=())
    parts = [replace(alone, maneuver=name) for name in names]
    return replace(run, experiment=combined(parts))


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


def _with_other_kpis(run: Run, other: Run) -> Run:
    """Return `run` with other names for the KPIs that `other` has in another unit."""
    units = {kpi.name: kpi.unit for kpi in other.kpis}
    names = {
        kpi.name: f"{kpi.name} [{kpi.unit}]"
        for kpi in run.kpis
        if units.get(kpi.name, kpi.unit) != kpi.unit
    }
    if not names:
        return run
    values = {names.get(name, name): value for name, value in run.experiment.kpis.items()}
    kpis = tuple(replace(kpi, name=names.get(kpi.name, kpi.name)) for kpi in run.kpis)
    return replace(run, experiment=run.experiment.with_kpis(values), kpis=kpis)


_Key = tuple[str, str, int]
"""Name and unit of a curve, and its position among those of the same name and unit."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """The panels that two runs share.

    Args:
        panels: Panels from top to bottom.
        keys: Curve of each panel.
    """

    panels: tuple[Plot, ...]
    keys: tuple[_Key, ...]

    @classmethod
    def of(cls, left: Experiment, right: Experiment) -> "_Layout":
        """Return the panels of two runs: those of the left one first, and inputs last."""
        # Limits and targets may differ between the maneuvers of a run, too.
        every = [run for e in (left, right) for run in (e, *e.runs)]
        curves = [_curves(run) for run in every]
        held = {
            key: all(side[key].held for side in curves if key in side)
            for key in dict.fromkeys(key for side in curves for key in side)
        }
        keys = sorted(held, key=lambda key: held[key])
        fixed = _with_fixed_targets(every)
        panels = []
        for key in keys:
            looks = [side[key].channel for side in curves if key in side]
            look = _look(looks, keeps_target=key[0] in fixed)
            label = _label(key, keys)
            reference = "" if look.target is not None else _reference(label)
            panels.append(Plot(look, "u" if held[key] else "y", label, reference=reference))
        return cls(tuple(panels), tuple(keys))

    def applied(self, experiment: Experiment) -> Experiment:
        """Return `experiment` with one channel for each panel; without values if it has none."""
        known, n = _curves(experiment), len(experiment.t)
        pairs = list(zip(self.keys, self.panels, strict=True))
        y = [(p, known[k].values(experiment) if k in known else np.full(n, np.nan))
             for k, p in pairs if not p.held]  # fmt: skip
        u = [(p, known[k].values(experiment)) for k, p in pairs if p.held and k in known]
        channels = Channels(
            x=(), u=tuple(replace(p.channel, name=p.name) for p, _ in u),
            y=tuple(replace(p.channel, name=p.name) for p, _ in y),
            time_unit=experiment.channels.time_unit,
        )  # fmt: skip
        references = _references(experiment)
        drawn = {
            panel.reference: references[key[0]]
            for key, panel in pairs
            if panel.reference and not panel.held and key in known and key[0] in references
        }
        steps = len(experiment.t_control)
        return replace(
            experiment, x=np.zeros((n, 0)), y=_table([v for _, v in y], n),
            u=_table([v for _, v in u], n), u_control=np.zeros((steps, len(u))),
            y_ref=np.full((steps, len(y)), np.nan), channels=channels, signals=drawn,
            runs=tuple(self.applied(run) for run in experiment.runs),
        )  # fmt: skip


def _curves(experiment: Experiment) -> dict[_Key, Plot]:
    """Return the curves of a run by name and unit."""
    found: dict[_Key, Plot] = {}
    for plot in plots_of(experiment.channels):
        name, unit, nth = plot.channel.name, plot.channel.unit, 0
        while (name, unit, nth) in found:
            nth += 1
        found[name, unit, nth] = plot
    return found


def _label(key: _Key, keys: Sequence[_Key]) -> str:
    """Return a name that no other curve has."""
    name, unit, nth = key
    others = {other for other_name, other, _ in keys if other_name == name}
    label = name if len(others) == 1 else f"{name} [{unit}]"
    return f"{label} ({nth + 1})" if nth else label


def _reference(name: str) -> str:
    """Return the key of the signal that holds the reference of an output; see `plots_of`."""
    return f"{name} ref"


def _table(columns: Sequence[Float[np.ndarray, " K"]], n: int) -> Float[np.ndarray, "K m"]:
    return np.stack(columns, axis=1) if columns else np.zeros((n, 0))


def _look(looks: Sequence[Channel], *, keeps_target: bool) -> Channel:
    """Return what all runs agree on of a channel."""

    def agreed(name: str, otherwise: float | None) -> Any:
        found = {getattr(channel, name) for channel in looks}
        return found.pop() if len(found) == 1 else otherwise

    target = agreed("target", None) if keeps_target else None
    return replace(
        looks[0], low=agreed("low", -np.inf), high=agreed("high", np.inf), target=target,
        band=None if target is None else agreed("band", None),
    )  # fmt: skip


def _with_fixed_targets(experiments: Sequence[Experiment]) -> frozenset[str]:
    """Return the names of the curves whose reference, if any, is their target all the time."""
    targets = [{c.name: c.target for c in e.channels.y} for e in experiments]
    moving = {
        name
        for experiment, target in zip(experiments, targets, strict=True)
        for name, values in _references(experiment).items()
        if not (values == target.get(name)).all()
    }
    names = [name for e in experiments for name, _, _ in _curves(e)]
    return frozenset(names) - moving


def _references(experiment: Experiment) -> dict[str, Float[np.ndarray, " K"]]:
    """Return the reference of each output that has one, on `t`."""
    if not len(experiment.t_control):
        return {}
    held = np.searchsorted(experiment.t_control, experiment.t, side="right") - 1
    values = experiment.y_ref[np.maximum(held, 0)]
    return {
        channel.name: values[:, j]
        for j, channel in enumerate(experiment.channels.y)
        if np.isfinite(values[:, j]).any()
    }
