"""Draw the knobs: every θ tried, and the learned cost along each knob through the best θ."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from prefcal_app.view.status import slices_view
from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.presentation.style import BEST, FAINT, HEAT, INK, canvas
from prefcal_scenarios.presentation.wording import knob_axis, knob_number, number

from .record import Record

_ACROSS = 3
"""Number of slices next to each other."""


def learned(record: Record) -> Figure:
    """Draw a slice of the learned cost for each knob, with the experiments, as the page does."""
    assert record.best is not None
    assert record.surrogate is not None
    space, best = record.scenario.space, record.best.experiment.theta
    views = slices_view(space, best, record.thetas, record.surrogate)
    across = min(len(views), _ACROSS)
    down = -(-len(views) // across)
    figure = canvas(0.3 + 2.5 * down)
    grid = figure.subplots(down, across, squeeze=False)
    for axes in grid.flat[len(views) :]:
        axes.set_visible(False)
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "clip_on": False}
    for axes, view, knob in zip(grid.flat, views, space, strict=False):
        samples = view["samples"]
        axes.plot(samples["x"], samples["y"], **dot, color=FAINT, alpha=0.45, ms=3.6, mew=0)
        axes.plot(view["x"], view["y"], color=BEST, linewidth=2)
        height = np.interp(view["best"], view["x"], view["y"])
        axes.plot(view["best"], height, **dot, color=BEST, ms=7, mec="white", mew=1.2, zorder=5)
        axes.set_xlabel(knob_axis(knob))
        if knob.scale == "log10":
            axes.set_xscale("log")
            axes.xaxis.set_minor_locator(NullLocator())
        else:
            axes.xaxis.set_major_locator(MaxNLocator(5, integer=knob.integer))
        axes.set_xlim(knob.low, knob.high)
    grid[0, 0].set_ylabel("learned cost, square root\n(0: the lowest shown)")
    return figure


def tried(record: Record) -> Figure:
    """Draw each θ as a line across the knobs' axes, later ones darker; the best is blue."""
    assert record.best is not None
    space = record.scenario.space
    cube = np.array([space.encode(theta) for theta in record.thetas])
    norm = Normalize(1, max(record.trials[-1].number, 2))
    figure = canvas(3.8)
    axes = figure.subplots()
    places = np.arange(len(space))
    colors = HEAT.reversed()
    for trial, point in zip(record.trials, cube, strict=True):
        dashes = ":" if trial.experiment.end.interrupted else "-"
        color = colors(norm(trial.number))
        axes.plot(places, point, color=color, linewidth=1.1, linestyle=dashes)
    best = space.encode(record.best.experiment.theta)
    axes.plot(places, best, color="white", linewidth=5.5, zorder=4, solid_capstyle="round")
    axes.plot(places, best, "o-", color=BEST, linewidth=2.8, markersize=7, zorder=5, clip_on=False)
    _axis_lines(axes, list(space), record.best.experiment.theta.tolist())
    bar = figure.colorbar(ScalarMappable(norm, colors), ax=axes, pad=0.02, aspect=26)
    bar.outline.set_visible(False)
    bar.set_label("number of the experiment", color=INK)
    bar.ax.yaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.set_title(
        f"All {len(cube)} θ tried; best in blue (experiment {record.best.number})", pad=22
    )
    return figure


def _axis_lines(axes: Axes, knobs: Sequence[Knob], best: Sequence[float]) -> None:
    """Draw an axis for each knob with its ends; the value of the best θ is below."""
    axes.grid(False)
    for name in ("left", "bottom"):
        axes.spines[name].set_visible(False)
    axes.set_yticks([])
    axes.set_xticks(range(len(knobs)), [knob_axis(k) for k in knobs], color=INK, fontsize=10)
    axes.tick_params(axis="x", pad=14)
    axes.set_xlim(-0.12, len(knobs) - 1 + 0.25)
    axes.set_ylim(-0.02, 1.02)
    text: dict[str, Any] = {"textcoords": "offset points", "ha": "center"}
    text["annotation_clip"] = False
    for i, (knob, value) in enumerate(zip(knobs, best, strict=True)):
        axes.axvline(i, color="#c5ccd3", linewidth=1.2, zorder=0)
        low, high, here = number(knob.low), number(knob.high), f"best {knob_number(knob, value)}"
        axes.annotate(low, (i, 0), (0, -5), va="top", color=FAINT, fontsize=8.5, **text)
        axes.annotate(high, (i, 1), (0, 5), va="bottom", color=FAINT, fontsize=8.5, **text)
        # Below the name: at the point, it would cover lines and the axis' ends.
        axes.annotate(here, (i, 0), (0, -36), va="top", color=BEST, fontweight="bold", **text)
