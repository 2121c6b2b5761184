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

from .record import StudyRecord

_ACROSS = 3
"""Largest number of maneuvers next to each other; more would be too narrow to read."""
_LINE = 76
"""Number of characters of θ that fit above half of a figure."""


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """A run to draw."""

    experiment: Experiment
    label: str
    color: str
    width: float = 1.7
    dashes: Any = "-"


_Row = tuple[Plot, bool]
"""A panel, and whether it is a zoom on the range around its target."""


@dataclass(frozen=True, slots=True)
class _Block:
    """Panels below each other with the same curves, and a heading above them."""

    heading: str
    rows: Sequence[_Row]
    curves: Sequence[DrawnRun]
    own: bool = False
    """Whether targets and limits are those of the first run, not of the scenario."""


def curves_of(record: StudyRecord, *, references: bool = True) -> list[DrawnRun]:
    """Return the baseline, the references and the best run, except runs without a record."""
    assert record.best is not None
    first, best = record.before, record.best
    alone = {record.baseline: first.experiment}
    (name, _), *others = (record.compared_with if references else alone).items()
    curves = [DrawnRun(first.experiment, f"{name} ({first.number})", FIRST, 1.4)]
    for i, (name, experiment) in enumerate(others):
        color, dashes = look(i)
        curves.append(DrawnRun(experiment, name, color, 1.5, dashes))
    curves.append(DrawnRun(best.experiment, f"best (experiment {best.number})", BEST, 2.0))
    return [curve for curve in curves if _has_record(curve.experiment)]


def best_against(
    record: StudyRecord, *, references: bool = True, panels: int | None = None, most: float = np.inf
) -> Figure | None:
    """Draw the best trajectory with what it is compared with; None without any record.

    Args:
        record: Record of the study.
        references: Whether to draw the references, and zooms on targets with a narrow band.
        panels: Largest number of panels, most important first; None for all.
        most: Largest height of the figure, in inches.
    """
    curves = curves_of(record, references=references)
    if not curves:
        return None
    draws = partial(panels_of, record.scenario)
    return _together(lambda *runs: draws(*runs)[:panels], curves, zooms=references, most=most)


def figure(
    scenario: Scenario,
    left: Experiment,
    right: Experiment,
    labels: tuple[str, str] = ("1", "2"),
    *,
    own: bool = False,
) -> Figure:
    """Draw two experiments side by side on equal axes, a row for each panel and maneuver.

    Args:
        scenario: Scenario of both experiments.
        left: Left experiment.
        right: Right experiment.
        labels: Labels of the left and the right experiment.
        own: Whether each has targets and limits of its own, as on a varied plant.
    """
    pair = (DrawnRun(left, labels[0], BEST, 1.9), DrawnRun(right, labels[1], OTHERS[0], 1.9))
    parts = maneuvers_of(left, right)
    blocks = []
    for part, runs in parts.items():
        rows = [(panel, False) for panel in panels_of(scenario, *runs)]
        for curve, run in zip(pair, runs, strict=True):
            heading = part if curve is pair[0] else ""
            blocks.append(_Block(heading, rows, [replace(curve, experiment=run)], own))
    with style():
        drawn, tops = _drawn(blocks, 2, 0.8 + 1.75 * sum(len(b.rows) for b in blocks) / 2)
        up = 15 if any(parts) else 0  # above the name of the first maneuver
        thetas = [_theta_lines(scenario, curve.experiment.theta) for curve in pair]
        label = 24 + 12 * max(map(len, thetas)) + up
        for axes, curve, lines in zip(tops[:2], pair, thetas, strict=True):
            _above(axes, "\n".join(lines), 21 + up, color=FAINT, fontsize=8.5)
            _above(axes, curve.label, label, color=curve.color, fontweight="bold")
    return drawn


def alone(scenario: Scenario, experiment: Experiment) -> Figure:
    """Draw one experiment, a panel per signal, with a zoom on targets that have a narrow band.

    Args:
        scenario: Scenario of the experiment.
        experiment: Experiment that left a record.
    """
    theta = "\n".join(_theta_lines(scenario, experiment.theta))
    with style():
        curve = DrawnRun(experiment, theta, BEST, 1.9)
        return _together(partial(panels_of, scenario), [curve], zooms=True)


def overlaid(panels: Sequence[Plot], curves: Sequence[DrawnRun]) -> Figure:
    """Draw experiments over each other, a panel per signal, with the references that change.

    Several maneuvers are drawn next to each other.

    Args:
        panels: Panels from top to bottom, the same for all experiments.
        curves: Experiments with their labels and colors.
    """
    return _together(lambda *_: tuple(panels), curves)


def _together(
    panels: Callable[..., Sequence[Plot]],
    curves: Sequence[DrawnRun],
    *,
    zooms: bool = False,
    most: float = np.inf,
) -> Figure:
    """Draw runs over each other: a column of panels for each maneuver, with a legend.

    Args:
        panels: Function that returns the panels of the runs of one maneuver.
        curves: Runs with their labels and colors; one or more left a record.
        zooms: Whether a narrow band around a target gets a panel of its own, without maneuvers.
        most: Largest height of the figure, in inches.
    """
    parts = maneuvers_of(*(curve.experiment for curve in curves))
    blocks = []
    for part, runs in parts.items():
        found = [
            replace(curve, experiment=run)
            for curve, run in zip(curves, runs, strict=True)
            if len(run.t) or len(parts) == 1
        ]
        if found:
            drawn = panels(*(c.experiment for c in found))
            zoomed = zooms and len(parts) == 1
            rows = list(_zoomed(drawn, found)) if zoomed else [(panel, False) for panel in drawn]
            blocks.append(_Block(part, rows, found))
    across = min(len(blocks), _ACROSS)
    count = max(len(block.rows) for block in blocks) * -(-len(blocks) // across)
    each = 1.75 if len(parts) == 1 else 1.6
    height = 0.75 + each * count if np.isinf(most) else min(most, 0.8 + 2.2 * count)
    figure, tops = _drawn(blocks, across, height, short=len(parts) > 1)
    fullest = max(range(len(blocks)), key=lambda i: len(blocks[i].curves))
    legend(figure, tops[fullest], len(curves))
    return figure


def _drawn(
    blocks: Sequence[_Block], across: int, height: float, *, short: bool = False
) -> tuple[Figure, list[Axes]]:
    """Draw blocks next to each other; return the figure, and the first axes of each block.

    Blocks of the same rows next to each other share their axes.

    Args:
        blocks: Blocks from left to right, then from top to bottom.
        across: Number of blocks next to each other.
        height: Height of the figure, in inches.
        short: Whether titles name only the signal and its unit.
    """
    count = max(len(block.rows) for block in blocks)
    figure = canvas(height)
    grid = figure.subplots(count * -(-len(blocks) // across), across, squeeze=False)
    for axes in grid.flat:
        axes.set_visible(False)
    tops = []
    for i, block in enumerate(blocks):
        top, column = i // across * count, i % across
        places = list(grid[top : top + len(block.rows), column])
        same = column > 0 and blocks[i - 1].rows is block.rows
        for axes, left in zip(places, grid[top:, 0], strict=False):
            axes.set_visible(True)
            axes.tick_params(labelbottom=axes is places[-1], labelleft=not same)
            if same:
                axes.sharey(left)
            if axes is not grid[top, 0] and (same or axes is not places[0]):
                axes.sharex(grid[top, 0] if same else places[0])
        _fill(places, block, short=short)
        if block.heading:
            _above(places[0], block.heading, 21, fontweight="bold")
        tops.append(places[0])
    return figure, tops


def _has_record(experiment: Experiment) -> bool:
    """Return whether an experiment, or any of its maneuvers, left a record."""
    return any(len(run.t) for run in experiment.runs or (experiment,))


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


def _above(axes: Axes, text: str, points: float, **look: Any) -> None:
    axes.annotate(text, (0, 1), (0, points), xycoords="axes fraction", textcoords="offset points", **look)


def _zoomed(panels: Sequence[Plot], curves: Sequence[DrawnRun]) -> Iterator[_Row]:
    """Yield every panel, followed by a zoom if its accepted band would look like a line."""
    for panel in panels:
        yield panel, False
        every = np.concatenate([panel.values(c.experiment) for c in curves])
        spread = np.ptp(every[np.isfinite(every)]) if np.isfinite(every).any() else 0.0
        band = panel.channel.band
        if panel.channel.target is not None and band is not None and 2 * band < 0.15 * spread:
            yield panel, True


def _fill(axes: Sequence[Axes], block: _Block, *, short: bool) -> None:
    """Draw the curves of a block; `short` titles name only the signal and its unit."""
    for place, (panel, zoomed) in zip(axes, block.rows, strict=True):
        channel = _own(panel, block.curves[0].experiment) if block.own else panel.channel
        _limits(place, channel)
        for curve in block.curves:
            _reference(place, panel, curve.experiment)
            _draw(place, panel, curve)
        named = replace(channel, target=None, band=None, low=-np.inf, high=np.inf)
        place.set_title(panel_title(named if short else channel, zoomed=zoomed))
        if zoomed and channel.target is not None and channel.band is not None:
            place.set_ylim(channel.target - 3 * channel.band, channel.target + 3 * channel.band)
        place.margins(x=0.01)
    axes[-1].set_xlabel(f"time [{block.curves[0].experiment.channels.time_unit}]")


def _own(panel: Plot, experiment: Experiment) -> Channel:
    """Return the channel of a panel, with the target and the limits of this run where both have them."""
    found = [c for c in (*experiment.channels.y, *experiment.channels.u) if c.name == panel.name]
    changes = {}
    for name in ("target", "low", "high") if found else ():
        drawn, own = getattr(panel.channel, name), getattr(found[0], name)
        if drawn is not None and own is not None and np.isfinite([drawn, own]).all():
            changes[name] = panel.scale * own
    return replace(panel.channel, **changes)


def _reference(axes: Axes, panel: Plot, experiment: Experiment) -> None:
    """Draw a reference that changes in time, as the runs recorded it."""
    values = experiment.signals.get(panel.reference)
    if values is not None and len(experiment.t):
        axes.plot(
            experiment.t,
            panel.scale * np.asarray(values),
            drawstyle="steps-post",
            color=GOOD,
            linewidth=0.9,
            linestyle=(0, (1, 2)),
        )


def _draw(axes: Axes, panel: Plot, curve: DrawnRun) -> None:
    t, values = curve.experiment.t, panel.values(curve.experiment)
    if not np.isfinite(values).any():
        return
    axes.plot(
        t,
        values,
        label=curve.label,
        color=curve.color,
        linewidth=curve.width,
        linestyle=curve.dashes,
        drawstyle="steps-post" if panel.held else "default",
    )
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
