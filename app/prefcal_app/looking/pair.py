"""The runs of a look: read from tables and studies, as experiments with their KPIs."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_app.view.question import Seen, pair_view
from prefcal_env.experiments.events import BAND
from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.experiments.kpis import KPI, every_tracking_kpi, tracking_kpis
from prefcal_env.experiments.panels import MEAN, Plot, by_maneuver, combined, named, plots_of
from prefcal_env.units import AS_IT_IS, Conversion, conversion, same, seconds

# --- Compute KPIs of any run and say their units: tracking errors, or the range of a curve.

_KINDS = (
    "settling time",
    "recovery time",
    "overshoot",
    "lag",
    "integrated error",
    "final error",
    "late error",
    "total move",
    "largest move",
    "RMS move",
)
"""Kinds of tracking KPIs, the most telling ones first."""


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
        timed = (f"settling time of {channel.name}", f"recovery time of {channel.name}")
        kpis = [_within_band(kpi, channel) if kpi.name in timed else kpi for kpi in kpis]
        y = experiment.output(j)
        if y is None or f"integrated error of {channel.name}" in values:
            continue
        for words, value, about in _statistics(experiment.t, y):
            name = f"{words} of {channel.name}"
            values[name] = value
            kpis.append(KPI(name, name, channel.unit, about=about))
    return experiment.with_kpis(values), tuple(kpis)


def _within_band(kpi: KPI, channel: Channel) -> KPI:
    """Return the KPI of a settling time with its band in the title."""
    given = channel.band is not None
    band = f"{channel.band:g} {channel.unit}".rstrip() if given else f"{100 * BAND:g} %"
    of = "" if given else ", a share of the change"
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


# --- Bring two runs from anywhere to the same panels, time axis and KPIs.


@dataclass(frozen=True, slots=True)
class NamedRun:
    """A run to look at."""

    name: str  # name, as shown to people
    experiment: Experiment
    kpis: tuple[KPI, ...] = ()  # titles, units and directions of its KPIs
    about: str = ""  # where it is from, and what was taken for what, in a sentence

    def changed(self, change: Callable[[Experiment], Experiment]) -> "NamedRun":
        """Return this run with a change of its experiment, and of each of its maneuvers."""
        return replace(self, experiment=_each(self.experiment, change))


Aligned = tuple[NamedRun, NamedRun, tuple[Plot, ...], tuple[KPI, ...], tuple[str, ...]]
"""Both runs, their panels from top to bottom, the KPIs that either has, and what was changed."""


def aligned(left: NamedRun, right: NamedRun, *, align: bool | None = None) -> Aligned:
    """Return two runs with the same curves, so that one set of panels draws both.

    The right run's times, curves and KPIs are converted to the units of the left one. Curves share a
    panel if name and unit are equal; a curve that only one run has gets a panel, too.
    With `align` both start at 0; None to do so only if their times do not overlap.
    """
    right, notes = _in_units_of(left, right)
    left, right = _with_maneuvers_of(left, right), _with_maneuvers_of(right, left)
    if align or (align is None and _apart(left.experiment, right.experiment)):
        starts = [run.experiment.t[0] for run in (left, right) if len(run.experiment.t)]
        left, right = _from_zero(left), _from_zero(right)
        if any(starts):
            notes = (*notes, "Both runs start at 0 here: their own times are left out.")
    right = _with_other_kpis(right, left)
    kpis = {kpi.name: kpi for run in (left, right) for kpi in run.kpis}
    panels = _panels([left.experiment, right.experiment])
    left, right = (run.changed(lambda each: _draw(each, panels)) for run in (left, right))
    return left, right, tuple(panels.values()), tuple(kpis.values()), notes


def aligned_view(
    left: NamedRun, right: NamedRun, panels: Sequence[Plot], kpis: Sequence[KPI], notes: Sequence[str]
) -> dict[str, Any]:
    """Return what the page shows of two aligned runs: what `question_view` returns, without a study."""
    view = pair_view(left.experiment, right.experiment, lambda *_: panels, kpis, Seen())
    nothing: dict[str, Any] = dict.fromkeys(("number", "role", "marks"))
    nothing |= {"counts_as_unsafe": False, "theta": []}
    for side, run in (("left", left), ("right", right)):
        view[side] |= {"name": run.name, "about": run.about, **nothing}
    unit = left.experiment.channels.time_unit
    return {**view, "id": f"{left.name}\n{right.name}", "time_unit": unit, "notes": list(notes)}


def _each(experiment: Experiment, change: Callable[[Experiment], Experiment]) -> Experiment:
    runs = tuple(_each(run, change) for run in experiment.runs)
    return replace(change(experiment), runs=runs)


def _in_units_of(left: NamedRun, right: NamedRun) -> tuple[NamedRun, tuple[str, ...]]:
    """Return the right run with its times, curves and KPIs in the units of the left one, and what to say."""
    wanted, given = (run.experiment.channels.time_unit for run in (left, right))
    said = []
    if wanted and given and not same(wanted, given):
        if seconds(wanted) is None or seconds(given) is None:
            said.append(f"The times of {left.name} are in {wanted}, those of {right.name} in {given}.")
        else:
            right = in_time_unit(right, wanted)
            said.append(f"The times of {right.name} are converted from {given} to {wanted}.")
    changes: dict[str, tuple[str, Conversion]] = {}
    theirs = _units(left.experiment)
    for name, unit in _units(right.experiment).items():
        found = conversion(unit, theirs[name]) if unit and theirs.get(name) else None
        if found is not None and unit != theirs[name]:
            changes[name] = theirs[name], found
            if found != AS_IT_IS:
                said.append(f"{name} of {right.name} is converted from {unit} to {theirs[name]}.")
    right = right.changed(lambda e: _curves_in(e, changes)) if changes else right
    return _kpis_in(right, _kpi_changes(left, right)), tuple(said)


def _units(experiment: Experiment) -> dict[str, str]:
    """Return the unit of each curve by its name, but for names with several."""
    channels = experiment.channels
    every = [(c.name, c.unit) for group in (channels.x, channels.u, channels.y) for c in group]
    found = dict(every)
    return {name: unit for name, unit in found.items() if all(u == unit for n, u in every if n == name)}


def _curves_in(e: Experiment, changes: Mapping[str, tuple[str, Conversion]]) -> Experiment:
    """Return an experiment with some of its curves, by name, in other units."""
    nothing = ("", AS_IT_IS)

    def columns(values: Float[np.ndarray, "K n"], channels: Sequence[Channel]) -> Float[np.ndarray, "K n"]:
        each = [changes.get(c.name, nothing)[1] for c in channels]
        factors, offsets = np.array([[c.factor, c.offset] for c in each]).reshape(-1, 2).T
        return np.asarray(values * factors + offsets)

    def looks(channels: Sequence[Channel]) -> tuple[Channel, ...]:
        each = [(c, *changes.get(c.name, (c.unit, AS_IT_IS))) for c in channels]
        return tuple(replace(c.scaled(to.factor, to.offset), unit=unit) for c, unit, to in each)

    x, u, y = e.channels.x, e.channels.u, e.channels.y
    return replace(
        e,
        x=columns(e.x, x),
        u=columns(e.u, u),
        u_control=columns(e.u_control, u),
        y=None if e.y is None else columns(e.y, y),
        y_ref=columns(e.y_ref, y),
        signals={n: changes.get(n.removesuffix(" ref"), nothing)[1].to(v) for n, v in e.signals.items()},
        channels=Channels(looks(x), looks(u), looks(y), e.channels.time_unit),
    )


def _kpi_changes(left: NamedRun, right: NamedRun) -> dict[str, tuple[str, float]]:
    """Return the left run's unit of KPIs of the right one by name, and the factor to it.

    What has another zero in it is left as it is, unless it is known to be a difference.
    """
    units, differences = {k.name: k.unit for k in left.kpis}, every_tracking_kpi(right.experiment.channels)
    found = {}
    for kpi in right.kpis:
        unit = units.get(kpi.name, kpi.unit)
        to = conversion(kpi.unit, unit, difference=kpi.name in differences)
        if unit != kpi.unit and to is not None and not to.offset:
            found[kpi.name] = unit, to.factor
    return found


def in_time_unit(run: NamedRun, unit: str) -> NamedRun:
    """Return a run whose times, and KPIs that depend on time, are in `unit`, such as "s".

    A KPI in minutes becomes one in seconds, one in m min one in m s. Rates such as m/min stay.
    """
    given = run.experiment.channels.time_unit
    found = conversion(given, unit)
    factor = 1.0 if found is None else found.factor
    powers = {given: (unit, 1), f"{given}²": (f"{unit}²", 2)}
    changes = {}
    for kpi in run.kpis:
        parts = [powers.get(part, (part, 0)) for part in kpi.unit.split(" ")]
        by = factor ** sum(power for _, power in parts)
        changes[kpi.name] = " ".join(part for part, _ in parts), by

    def scaled(e: Experiment) -> Experiment:
        channels = replace(e.channels, time_unit=unit)
        return replace(e, t=factor * e.t, t_control=factor * e.t_control, channels=channels)

    return _kpis_in(run.changed(scaled), changes)


def _kpis_in(run: NamedRun, changes: Mapping[str, tuple[str, float]]) -> NamedRun:
    """Return a run with KPIs in other units: the unit of each by name, and the factor to it."""

    def factor(name: str) -> float:
        in_one_maneuver = name.rpartition(" (")[0]
        return changes.get(name, changes.get(in_one_maneuver, ("", 1.0)))[1]

    kpis = []
    for kpi in run.kpis:
        unit, by = changes.get(kpi.name, (kpi.unit, 1.0))
        kpis.append(replace(kpi, unit=unit, at_most=by * kpi.at_most, at_least=by * kpi.at_least))

    def scaled(e: Experiment) -> Experiment:
        return replace(e, kpis={name: value * factor(name) for name, value in e.kpis.items()})

    return replace(run.changed(scaled), kpis=tuple(kpis)) if changes else run


def _with_maneuvers_of(run: NamedRun, other: NamedRun) -> NamedRun:
    """Return `run` as one that does the same in each maneuver of the other one, if it has none."""
    names = [name for name in by_maneuver(other.experiment) if name]
    if not names or "" not in by_maneuver(run.experiment):
        return run
    alone = replace(run.experiment, runs=())
    return replace(run, experiment=combined([replace(alone, maneuver=name) for name in names]))


def _apart(left: Experiment, right: Experiment) -> bool:
    """Return whether the times of two runs do not overlap."""
    if not (len(left.t) and len(right.t)):
        return False
    return bool(left.t[-1] < right.t[0] or right.t[-1] < left.t[0])


def _from_zero(run: NamedRun) -> NamedRun:
    start = run.experiment.t[0] if len(run.experiment.t) else 0.0
    return run.changed(lambda e: replace(e, t=e.t - start, t_control=e.t_control - start))


def _with_other_kpis(run: NamedRun, other: NamedRun) -> NamedRun:
    """Return `run` with other names for the KPIs that `other` has in another unit."""
    units = {kpi.name: kpi.unit for kpi in other.kpis}
    names = {
        kpi.name: f"{kpi.name} [{kpi.unit}]" for kpi in run.kpis if units.get(kpi.name, kpi.unit) != kpi.unit
    }
    if not names:
        return run
    values = {names.get(name, name): value for name, value in run.experiment.kpis.items()}
    kpis = tuple(replace(kpi, name=names.get(kpi.name, kpi.name)) for kpi in run.kpis)
    return replace(run, experiment=run.experiment.with_kpis(values), kpis=kpis)


_Curve = tuple[str, str, int]
"""Name and unit of a curve, and its position among the channels of the same name."""


def _panels(experiments: Iterable[Experiment]) -> dict[_Curve, Plot]:
    """Return a panel for each curve of either run: those of the left one first, and inputs last.

    What is the same in all runs that have the curve is drawn as its target, band and limits; other
    references are curves of their own.
    """
    every = [(_curves(run), _references(run)) for e in experiments for run in (e, *e.runs)]
    found = dict.fromkeys(curve for curves, _ in every for curve in curves)
    panels = {}
    for curve in found:
        name, unit, nth = curve
        plots = [curves[curve] for curves, _ in every if curve in curves]
        levels = {
            level
            for curves, references in every
            if curve in curves
            for level in np.unique(references.get(name, [np.nan]))
        }
        target = float(levels.pop()) if len(levels) == 1 else np.nan
        fixed = np.isfinite(target)
        channel = replace(
            plots[0].channel,
            target=target if fixed else None,
            band=_agreed(plots, "band", None) if fixed else None,
            low=_agreed(plots, "low", -np.inf),
            high=_agreed(plots, "high", np.inf),
        )
        label = name if len({u for n, u, _ in found if n == name}) == 1 else f"{name} [{unit}]"
        label += f" ({nth + 1})" if nth else ""
        kind = "u" if all(plot.held for plot in plots) else "signal"
        panels[curve] = Plot(channel, kind, label, reference="" if fixed else f"{label} ref")
    return dict(sorted(panels.items(), key=lambda item: item[1].held))


def _agreed(plots: Iterable[Plot], name: str, otherwise: float | None) -> Any:
    found = {getattr(plot.channel, name) for plot in plots}
    return found.pop() if len(found) == 1 else otherwise


def _curves(experiment: Experiment) -> dict[_Curve, Plot]:
    """Return the curves of a run."""
    plots = plots_of(experiment.channels)
    return {(plot.channel.name, plot.channel.unit, plot.nth): plot for plot in plots}


def _draw(experiment: Experiment, panels: dict[_Curve, Plot]) -> Experiment:
    """Return a run with the curves that it has under the names of the panels.

    Inputs stay inputs, which are held between instants; all others become signals.
    """
    known, references = _curves(experiment), _references(experiment)
    signals, inputs = {}, []
    for curve, panel in panels.items():
        if curve not in known:
            continue
        values = known[curve].values(experiment)
        if panel.held:
            inputs.append((replace(panel.channel, name=panel.name), values))
        else:
            signals[panel.name] = values
            if panel.reference and curve[0] in references:
                signals[panel.reference] = references[curve[0]]
    n, steps = len(experiment.t), len(experiment.t_control)
    u = np.stack([values for _, values in inputs], axis=1) if inputs else np.zeros((n, 0))
    channels = Channels((), tuple(c for c, _ in inputs), (), experiment.channels.time_unit)
    return replace(
        experiment,
        x=np.zeros((n, 0)),
        y=None,
        u=u,
        u_control=np.zeros((steps, len(inputs))),
        y_ref=np.zeros((steps, 0)),
        channels=channels,
        signals=signals,
    )


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
