"""Curves of an experiment in braille, for a terminal."""

import plotille
from rich.console import Group, RenderableType
from rich.text import Text

from prefcal_env.experiment import Experiment
from prefcal_scenarios.interview import Question
from prefcal_scenarios.report.wording import labelled, number
from prefcal_scenarios.scenario import Panel

_ROWS = 5
"""Height of a plot in lines."""


def curves(
    experiment: Experiment, question: Question, panels: tuple[Panel, ...], width: int, style: str
) -> RenderableType:
    """Every panel of one side, `width` characters wide, on axes that both sides share."""
    if not len(experiment.t):
        return Text("This run failed and left no record.", style="bold red")
    sides = [s.experiment for s in (question.left, question.right) if len(s.experiment.t)]
    end = max(e.duration for e in sides)
    parts: list[RenderableType] = []
    for panel in panels:
        low = min(float(panel.values(e).min()) for e in sides)
        high = max(float(panel.values(e).max()) for e in sides)
        parts.append(_title(panel, width))
        drawn = _plot(panel, experiment, (end, low, high), width)
        parts.append(Text(drawn, style=style, no_wrap=True, overflow="crop"))
        parts.append(Text(f"{'0':<{width - 14}}{number(end)} {experiment.channels.time_unit}"))
    return Group(*parts)


def _title(panel: Panel, width: int) -> Text:
    channel = panel.channel
    words = labelled(channel.name, channel.unit)
    if channel.target is not None:
        band = "" if channel.band is None else f" ± {number(channel.band)}"
        words += f", target {number(channel.target)}{band}"
    return Text(words, style="bold", no_wrap=True, overflow="ellipsis")


def _plot(panel: Panel, experiment: Experiment, box: tuple[float, float, float], width: int) -> str:
    """Rows of braille with the values of the upper and lower edge on the left."""
    end, low, high = box
    pad = 0.04 * (high - low) or 1.0
    low, high = low - pad, high + pad
    label = 9
    canvas = plotille.Canvas(width - label, _ROWS, 0.0, low, end, high)
    t, y = experiment.t.tolist(), panel.values(experiment).tolist()
    target = panel.channel.target
    if target is not None and low < target < high:
        for k in range(0, 2 * (width - label), 6):
            canvas.point(end * k / (2 * (width - label)), target)
    for k in range(len(t) - 1):
        after = y[k] if panel.kind == "u" else y[k + 1]
        canvas.line(t[k], y[k], t[k + 1], after)
        if panel.kind == "u":
            canvas.line(t[k + 1], y[k], t[k + 1], y[k + 1])
    rows = canvas.plot().split("\n")
    edges = {0: number(high), _ROWS - 1: number(low)}
    return "\n".join(f"{edges.get(i, ''):>{label - 2}} │{row}" for i, row in enumerate(rows))
