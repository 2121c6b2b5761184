"""Curves of an experiment in braille, for a terminal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotille
from jaxtyping import Float
from rich.console import Group, RenderableType
from rich.text import Text

from prefcal_env.experiment import Channel, Experiment
from prefcal_scenarios.interview import Question
from prefcal_scenarios.report.wording import labelled, number
from prefcal_scenarios.scenario import Panel

_ROWS = 5
"""Height of a plot in lines."""
_LABEL = 12
"""Characters to the left of a plot, for its upper and lower edge."""


@dataclass(frozen=True, slots=True)
class _Axes:
    """What a plot spans, alike on both sides."""

    start: float
    end: float
    low: float
    high: float


def curves(
    experiment: Experiment, question: Question, panels: Sequence[Panel], width: int, style: str
) -> RenderableType:
    """Every panel of one side, `width` characters wide, on axes that both sides share."""
    if not len(experiment.t):
        return Text("This run failed and left no record.", style="bold red")
    both = [s.experiment for s in (question.left, question.right) if len(s.experiment.t)]
    parts: list[RenderableType] = []
    for panel in panels:
        axes = _axes(panel, both)
        parts.append(Text(_title(panel.channel), style="bold", no_wrap=True, overflow="ellipsis"))
        if axes is None:
            parts.append(Text("no values", style="dim"))
            continue
        drawn = _plot(panel, experiment, axes, width)
        parts.append(Text(drawn, style=style, no_wrap=True, overflow="crop"))
        start, end = number(axes.start), f"{number(axes.end)} {experiment.channels.time_unit}"
        parts.append(Text(" " * _LABEL + start + end.rjust(width - _LABEL - len(start))))
    if len(experiment.runs) > 1:
        parts.append(Text(f"Curves: the first of {len(experiment.runs)} variants of this run."))
    return Group(*parts)


def _axes(panel: Panel, both: Sequence[Experiment]) -> _Axes | None:
    """Wide enough for both sides; None where neither has a finite value."""
    values = np.concatenate([panel.values(e) for e in both])
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    start, end = min(float(e.t[0]) for e in both), max(e.duration for e in both)
    low, high = float(values.min()), float(values.max())
    pad = 0.04 * (high - low) or max(1.0, 1e-9 * abs(high))
    return _Axes(start, end if end > start else start + 1.0, low - pad, high + pad)


def _title(channel: Channel) -> str:
    """What is drawn, its unit, and what it should do."""
    words = labelled(channel.name, channel.unit)
    if channel.target is not None:
        band = "" if channel.band is None else f" ± {number(channel.band)}"
        words += f", target {number(channel.target)}{band}"
    limits = [number(limit) for limit in (channel.low, channel.high) if np.isfinite(limit)]
    if limits:
        words += f", limit{'s' * (len(limits) - 1)} {' to '.join(limits)}"
    return words


def _plot(panel: Panel, experiment: Experiment, axes: _Axes, width: int) -> str:
    """Rows of braille with the values of the upper and lower edge on the left."""
    columns = width - _LABEL
    canvas = plotille.Canvas(columns, _ROWS, axes.start, axes.low, axes.end, axes.high)
    target = panel.channel.target
    if target is not None and axes.low < target < axes.high:
        for t in np.linspace(axes.start, axes.end, columns // 3).tolist():
            canvas.point(t, target)
    _curve(canvas, experiment.t, panel.values(experiment), steps=panel.kind == "u")
    rows = canvas.plot().split("\n")
    edges = {0: number(axes.high), _ROWS - 1: number(axes.low)}
    return "\n".join(f"{edges.get(i, ''):>{_LABEL - 2}} │{row}" for i, row in enumerate(rows))


def _curve(
    canvas: plotille.Canvas,
    t: Float[np.ndarray, " K"],
    y: Float[np.ndarray, " K"],
    *,
    steps: bool,
) -> None:
    """A line through all that is finite; inputs as steps."""
    finite = np.isfinite(y)
    for k in np.flatnonzero(finite).tolist():
        canvas.point(float(t[k]), float(y[k]))
    for k in np.flatnonzero(finite[:-1] & finite[1:]).tolist():
        before, after = float(y[k]), float(y[k + 1])
        here, there = float(t[k]), float(t[k + 1])
        canvas.line(here, before, there, before if steps else after)
        if steps:
            canvas.line(there, before, there, after)
