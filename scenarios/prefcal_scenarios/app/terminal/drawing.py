"""Draw the curves of an experiment in braille, for a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotille
from jaxtyping import Float
from rich.console import Group, RenderableType
from rich.text import Text

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.app.presentation.wording import labeled, number
from prefcal_scenarios.app.web.view.panels import reference_of

ROWS = 5
"""Default height of a plot in lines if the height of the screen is unknown."""
LEAST, MOST = 2, 8
"""Limits of the height of a plot that is fitted to the screen."""
_LABEL = 12
"""Characters to the left of a plot, for the values at its upper and lower edges."""


def curves(
    experiment: Experiment,
    panels: Sequence[Plot],
    axes: Mapping[str, Any],
    *,
    width: int,
    rows: int = ROWS,
    style: str = "",
) -> RenderableType:
    """Return every panel of one side, `width` characters wide, with one time axis below.

    Args:
        experiment: Experiment to draw.
        panels: Panels from top to bottom.
        axes: Axes that both sides share, as `Seen.frame` returns them.
        width: Width in characters.
        rows: Height of each plot in lines.
        style: Style of the curves.
    """
    if not len(experiment.t):
        return Text("This run failed and left no record.", style="bold red")
    parts: list[RenderableType] = []
    for panel, span in zip(panels, axes["y"], strict=True):
        parts.append(Text(_title(panel), style="bold", no_wrap=True, overflow="ellipsis"))
        if not np.isfinite(panel.values(experiment)).any():
            parts.append(Text("no values" + "\n" * (rows - 1), style="dim"))
            continue
        drawn = _plot(panel, experiment, (*axes["x"], *span), (width - _LABEL, rows))
        parts.append(Text(drawn, style=style, no_wrap=True, overflow="crop"))
    start, end = (number(v) for v in axes["x"])
    end = f"{end} {experiment.channels.time_unit}".strip()
    parts.append(Text(" " * _LABEL + start + end.rjust(width - _LABEL - len(start))))
    if len(experiment.runs) > 1:
        parts.append(Text(f"Curves: the first of {len(experiment.runs)} variants of this run."))
    return Group(*parts)


def lines_beside_plots(experiment: Experiment, panels: Sequence[Plot]) -> int:
    """Return the number of lines that `curves` needs in addition to the plots."""
    return len(panels) + 1 + (len(experiment.runs) > 1) if len(experiment.t) else 1


def _title(panel: Plot) -> str:
    """Return the title of a panel: the signal, its unit, and its target or limits."""
    channel = panel.channel
    words = labeled(channel.name, channel.unit)
    if channel.target is not None:
        band = "" if channel.band is None else f" ± {number(channel.band)}"
        words += f", target {number(channel.target)}{band}"
    limits = [number(limit) for limit in (channel.low, channel.high) if np.isfinite(limit)]
    if limits:
        words += f", limit{'s' * (len(limits) - 1)} {' to '.join(limits)}"
        words += " at most" if panel.low_signal or panel.high_signal else ""
    return words


def _plot(
    panel: Plot,
    experiment: Experiment,
    axes: tuple[float, float, float, float],
    size: tuple[int, int],
) -> str:
    """Return rows of braille with the values of the upper and lower edges on the left.

    The axes are start, end, low and high; the size is columns and rows.
    """
    (start, end, low, high), (columns, rows) = axes, size
    canvas = plotille.Canvas(columns, rows, start, low, end, high)
    target = panel.channel.target
    if target is not None and low < target < high:
        for t in np.linspace(start, end, columns // 3).tolist():
            canvas.point(t, target)
    reference = reference_of(panel, experiment)
    if reference is not None:
        for t in np.linspace(start, experiment.duration, columns // 3).tolist():
            k = max(int(np.searchsorted(experiment.t, t, side="right")) - 1, 0)
            canvas.point(t, float(reference[k]))
    _curve(canvas, experiment.t, panel.values(experiment), steps=panel.held)
    drawn = canvas.plot().split("\n")
    edges = {0: number(high), rows - 1: number(low)}
    return "\n".join(f"{edges.get(i, ''):>{_LABEL - 2}} │{row}" for i, row in enumerate(drawn))


def _curve(
    canvas: plotille.Canvas,
    t: Float[np.ndarray, " K"],
    y: Float[np.ndarray, " K"],
    *,
    steps: bool,
) -> None:
    """Draw a line through all finite points, with inputs as steps."""
    finite = np.isfinite(y)
    for k in np.flatnonzero(finite).tolist():
        canvas.point(float(t[k]), float(y[k]))
    for k in np.flatnonzero(finite[:-1] & finite[1:]).tolist():
        before, after = float(y[k]), float(y[k + 1])
        here, there = float(t[k]), float(t[k + 1])
        canvas.line(here, before, there, before if steps else after)
        if steps:
            canvas.line(there, before, there, after)
