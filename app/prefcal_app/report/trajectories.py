"""Draw closed-loop runs, overlaid or side by side."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.maneuvers import maneuvers_of
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.presentation.style import (
    BEST,
    FAINT,
    FIRST,
    GOOD,
    LIMIT,
    OTHERS,
    canvas,
    legend,
    look,
    style,
)
from prefcal_scenarios.presentation.wording import knob_number, mathtext, number
from prefcal_scenarios.scenario import Scenario, panels_of

from .record import Record

_ACROSS = 3
"""Largest number of maneuvers next to each other; more would be too narrow to read."""
_LINE = 76
"""Number of characters of θ that fit above half of a figure."""
_TALL = 2.2
"""Largest height of a panel on paper, in inches."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A run to draw."""

    experiment: Experiment
    label: str
    color: str
    width: float = 1.7
    dashes: Any = "-"


@dataclass(frozen=True, slots=True)
class _Row:
    """A panel, or a zoom on the range around its target."""

    panel: Plot
    zoomed: bool = False


def curves_of(record: Record) -> list[Curve]:
    """Return the baseline, the references and the best run, except runs without a record."""
    assert record.best is not None
    first, best = record.before, record.best
    (name, _), *references = record.compared_with.items()
    curves = [Curve(first.experiment, f"{name} ({first.number})", FIRST, 1.4)]
    for i, (name, experiment) in enumerate(references):
        color, dashes = look(i)
        curves.append(Curve(experiment, name, color, 1.5, dashes))
    curves.append(Curve(best.experiment, f"best (experiment {best.number})", BEST, 2.0))
    return [curve for curve in curves if _has_record(curve.experiment)]


def best_against(record: Record) -> Figure:
    """Draw the best trajectory with the baseline and the references, a panel per signal."""
    curves = curves_of(record)
    if _has_maneuvers(curves):
        return _multiples(partial(panels_of, record.scenario), curves)
    panels = panels_of(record.scenario, *(c.experiment for c in curves))
    rows = list(_rows(panels, curves))
    heights = [1.25 if row.zoomed else 1.9 for row in rows]
    return _with_legend(_stacked(rows, curves, 0.7 + sum(heights), heights), curves)


def before_and_after(record: Record, *, panels: int, height: float) -> Figure | None:
    """Draw the baseline and the best run in at most `panels` panels; None if neither has a record.

    Args:
        record: Record of the study.
        panels: Largest number of panels, most important first.
        height: Largest height of the figure, in inches.
    """
    assert record.best is not None
    runs = {
        number: Curve(experiment, label, color, width)
        for number, experiment, label, color, width in (
            (record.before.number, record.before.experiment, record.baseline.name, OTHERS[0], 1.7),
            (record.best.number, record.best.experiment, "best", BEST, 2.0),
        )
        if _has_record(experiment)
    }
    curves = list(runs.values())
    if not curves:
        return None
    if _has_maneuvers(curves):
        draws = partial(panels_of, record.scenario)
        return _multiples(draws, curves, most=panels, height=height)
    rows = [_Row(panel) for panel in panels_of(record.scenario, *(c.experiment for c in curves))]
    rows = rows[:panels]
    return _with_legend(_stacked(rows, curves, min(height, 0.8 + _TALL * len(rows))), curves)


def side_by_side(record: Record, other: str) -> Figure:
    """Draw the best trajectory on the left and the reference `other` on the right."""
    assert record.best is not None
    best, rival = record.best.experiment, record.references[other]
    pair = (
        Curve(best, "preference-based (this study)", BEST, 1.9),
        Curve(rival, other, OTHERS[0], 1.9),
    )
    return _pair(record.scenario, pair)


def figure(
    scenario: Scenario, left: Experiment, right: Experiment, labels: tuple[str, str] = ("1", "2")
) -> Figure:
    """Draw two experiments side by side on equal axes.

    Args:
        scenario: Scenario of both experiments.
        left: Left experiment.
        right: Right experiment.
        labels: Labels of the left and the right experiment.
    """
    pair = (Curve(left, labels[0], BEST, 1.9), Curve(right, labels[1], OTHERS[0], 1.9))
    with style():
        return _pair(scenario, pair)


def alone(scenario: Scenario, experiment: Experiment) -> Figure:
    """Draw one experiment, a panel per signal, with a zoom on targets that have a narrow band.

    Args:
        scenario: Scenario of the experiment.
        experiment: Experiment that left a record.
    """
    with style():
        curve = Curve(experiment, "this run", BEST, 1.9)
        if _has_maneuvers([curve]):
            return _multiples(partial(panels_of, scenario), [curve])
        rows = list(_rows(panels_of(scenario, experiment), [curve]))
        figure = _stacked(rows, [curve], 0.6 + 1.75 * len(rows))
        values = zip(scenario.space, experiment.theta, strict=True)
        theta = ",  ".join(f"{mathtext(k.name)} = {knob_number(k, v)}" for k, v in values)
        _above(figure.axes[0], theta, 21, color=FAINT, fontsize=8.5)
    return figure


def overlaid(panels: Sequence[Plot], curves: Sequence[Curve]) -> Figure:
    """Draw experiments over each other, a panel per signal, with the references that change.

    Several maneuvers are drawn next to each other.

    Args:
        panels: Panels from top to bottom, the same for all experiments.
        curves: Experiments with their labels and colors.
    """
    if _has_maneuvers(curves):
        return _multiples(lambda *_: tuple(panels), curves)
    rows = [_Row(panel) for panel in panels]
    return _with_legend(_stacked(rows, curves, 0.7 + 1.75 * len(rows)), curves)


def _stacked(
    rows: Sequence[_Row],
    curves: Sequence[Curve],
    height: float,
    heights: Sequence[float] | None = None,
) -> Figure:
    """Draw a panel for each row, below each other over one axis of time."""
    figure = canvas(height)
    grid = figure.subplots(len(rows), 1, sharex=True, squeeze=False, height_ratios=heights)
    _fill(list(grid[:, 0]), rows, curves)
    return figure


def _with_legend(figure: Figure, curves: Sequence[Curve]) -> Figure:
    legend(figure, figure.axes[0], len(curves))
    return figure


def _has_record(experiment: Experiment) -> bool:
    """Return whether an experiment, or any of its maneuvers, left a record."""
    return any(len(run.t) for run in experiment.runs or (experiment,))


def _has_maneuvers(curves: Sequence[Curve]) -> bool:
    return len(maneuvers_of(*(curve.experiment for curve in curves))) > 1


def _by_maneuver(curves: Sequence[Curve]) -> dict[str, list[Curve]]:
    """Return the curves of each maneuver, without the runs that left no record."""
    return {
        part: [
            replace(curve, experiment=run)
            for curve, run in zip(curves, runs, strict=True)
            if len(run.t)
        ]
        for part, runs in maneuvers_of(*(curve.experiment for curve in curves)).items()
    }


def _multiples(
    panels: Callable[..., Sequence[Plot]],
    curves: Sequence[Curve],
    *,
    most: int | None = None,
    height: float | None = None,
) -> Figure:
    """Draw a small plot for each panel and maneuver: a row of maneuvers below each panel's title.

    Args:
        panels: Function that returns the panels of the runs of one maneuver.
        curves: Runs with their labels and colors; one or more left a record.
        most: Largest number of panels, most important first; None for all.
        height: Height of a figure with that many panels, in inches; None for the usual one.
    """
    drawn = {part: found for part, found in _by_maneuver(curves).items() if found}
    plots = {part: panels(*(c.experiment for c in found))[:most] for part, found in drawn.items()}
    count = max(len(found) for found in plots.values())
    across = min(len(drawn), _ACROSS)
    down = -(-len(drawn) // across) * count
    whole = 0.8 + 1.6 * down if height is None else height
    figure = canvas(whole)
    grid = figure.subplots(down, across, squeeze=False)
    for place in grid.flat:
        place.set_visible(False)
    for i, (part, found) in enumerate(drawn.items()):
        top = i // across * count
        places = grid[top : top + len(plots[part]), i % across]
        for place in places:
            place.set_visible(True)
        _fill(list(places), [_Row(panel) for panel in plots[part]], found, _short)
        _above(places[0], part, 21, fontweight="bold")
    fullest = max(drawn, key=lambda part: len(drawn[part]))
    i = list(drawn).index(fullest)
    legend(figure, grid[i // across * count, i % across], len(curves))
    return figure


def _short(channel: Channel, *, zoomed: bool = False) -> str:
    """Return a title that fits above a small plot: the signal and its unit."""
    return panel_title(replace(channel, target=None, band=None, low=-np.inf, high=np.inf))


def _pair(scenario: Scenario, pair: Sequence[Curve]) -> Figure:
    """Draw two runs side by side, a row for each panel; the maneuvers below each other."""
    parts = maneuvers_of(*(curve.experiment for curve in pair))
    rows = {
        part: [_Row(panel) for panel in panels_of(scenario, *runs)] for part, runs in parts.items()
    }
    count = sum(map(len, rows.values()))
    figure = canvas(0.8 + 1.75 * count)
    grid = figure.subplots(count, 2, sharey="row", squeeze=False)
    top = 0
    for part, runs in parts.items():
        places = grid[top : top + len(rows[part])]
        _share_time(places)
        for column, (curve, run) in enumerate(zip(pair, runs, strict=True)):
            _fill(list(places[:, column]), rows[part], [replace(curve, experiment=run)])
        if part:
            _above(places[0, 0], part, 21, fontweight="bold")
        top += len(rows[part])
    up = 15 if any(parts) else 0  # above the name of the first maneuver
    thetas = [_theta_lines(scenario, curve.experiment.theta) for curve in pair]
    label = 24 + 12 * max(map(len, thetas)) + up
    for column, (curve, lines) in enumerate(zip(pair, thetas, strict=True)):
        _above(grid[0, column], "\n".join(lines), 21 + up, color=FAINT, fontsize=8.5)
        _above(grid[0, column], curve.label, label, color=curve.color, fontweight="bold")
    return figure


def _theta_lines(scenario: Scenario, theta: Float[np.ndarray, " n"]) -> list[str]:
    """Return θ in lines that fit above half of a figure."""
    lines, room = [""], 0
    for knob, value in zip(scenario.space, theta, strict=True):
        text = knob_number(knob, value)
        length = len(f"{knob.name} = {text},  ")
        if length > room:
            lines, room = [*lines, ""], _LINE
        lines[-1] += f"{',  ' if lines[-1] else ''}{mathtext(knob.name)} = {text}"
        room -= length
    return lines[1:]


def _share_time(places: "np.ndarray[Any, Any]") -> None:
    """Give these plots, row by row, one axis of time, with numbers below the last row only."""
    for place in places.flat[1:]:
        place.sharex(places[0, 0])
    for place in places[:-1].flat:
        place.tick_params(labelbottom=False)


def _above(axes: Axes, text: str, points: float, **look: Any) -> None:
    axes.annotate(
        text, (0, 1), (0, points), xycoords="axes fraction", textcoords="offset points", **look
    )


def _rows(panels: Sequence[Plot], curves: Sequence[Curve]) -> Iterator[_Row]:
    """Yield every panel, followed by a zoom if its accepted band would look like a line."""
    for panel in panels:
        yield _Row(panel)
        values = [panel.values(c.experiment) for c in curves]
        every = np.concatenate(values)
        spread = np.ptp(every[np.isfinite(every)]) if np.isfinite(every).any() else 0.0
        band = panel.channel.band
        if panel.channel.target is not None and band is not None and 2 * band < 0.15 * spread:
            yield _Row(panel, zoomed=True)


def _fill(
    axes: Sequence[Axes],
    rows: Sequence[_Row],
    curves: Sequence[Curve],
    title: Callable[..., str] | None = None,
) -> None:
    title = panel_title if title is None else title
    for place, row in zip(axes, rows, strict=True):
        channel = row.panel.channel
        _limits(place, channel)
        for curve in curves:
            _reference(place, row.panel, curve.experiment)
            _draw(place, row.panel, curve)
        place.set_title(title(channel, zoomed=row.zoomed))
        if row.zoomed and channel.target is not None and channel.band is not None:
            place.set_ylim(channel.target - 3 * channel.band, channel.target + 3 * channel.band)
        place.margins(x=0.01)
    axes[-1].set_xlabel(f"time [{curves[0].experiment.channels.time_unit}]")


def _reference(axes: Axes, panel: Plot, experiment: Experiment) -> None:
    """Draw a reference that changes in time, as the runs recorded it."""
    values = experiment.signals.get(panel.reference)
    if values is not None and len(experiment.t):
        axes.plot(experiment.t, panel.scale * np.asarray(values), drawstyle="steps-post",
                  color=GOOD, linewidth=0.9, linestyle=(0, (1, 2)))  # fmt: skip


def _draw(axes: Axes, panel: Plot, curve: Curve) -> None:
    t, values = curve.experiment.t, panel.values(curve.experiment)
    if not np.isfinite(values).any():
        return
    axes.plot(
        t, values, label=curve.label, color=curve.color, linewidth=curve.width,
        linestyle=curve.dashes, drawstyle="steps-post" if panel.held else "default",
    )  # fmt: skip
    # Runs end at different times: a dot marks a completed run, a cross a stopped one.
    marker = "X" if curve.experiment.end.interrupted else "o"
    axes.plot(t[-1], values[-1], marker, color=curve.color, markersize=5, markeredgewidth=0)


def _limits(axes: Axes, channel: Channel) -> None:
    if channel.target is not None:
        axes.axhline(channel.target, color=GOOD, linewidth=0.9, linestyle=(0, (1, 2)))
        if channel.band is not None:
            low, high = channel.target - channel.band, channel.target + channel.band
            axes.axhspan(low, high, color=GOOD, alpha=0.18, linewidth=0)
    for limit in (channel.low, channel.high):
        if np.isfinite(limit):
            axes.axhline(limit, color=LIMIT, linewidth=1.1, linestyle=(0, (6, 3)))


def panel_title(channel: Channel, *, zoomed: bool = False) -> str:
    """Return the title of a panel: the signal, its unit, and its target or limits."""
    parts = [channel.name[:1].upper() + channel.name[1:]]
    if channel.symbol:
        parts.append(f"${channel.symbol}$")
    text = " ".join(parts) + (f" [{channel.unit}]" if channel.unit else "")
    if zoomed:
        return f"{text} · around the target"
    if channel.target is not None:
        text += f" · target {number(channel.target)}"
        if channel.band is not None:
            share = channel.band / abs(channel.target) if channel.target else np.inf
            band = f"{number(100 * share)} %" if share < 1 else number(channel.band)
            text += f" ± {band}"
    limits = [number(v) for v in (channel.low, channel.high) if np.isfinite(v)]
    if not limits:
        return text
    return f"{text} · limit{'s' * (len(limits) - 1)} {' to '.join(limits)}"
