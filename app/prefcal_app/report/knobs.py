"""Draw along each knob what was tried and learned, as the page does."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from prefcal_app.view.status import slices_view
from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.presentation.style import BEST, FAINT, canvas
from prefcal_scenarios.presentation.wording import knob_axis, knob_number

from .record import Record

_ACROSS = 3
"""Number of knobs next to each other."""


def knobs(record: Record) -> Figure:
    """Draw each experiment along each knob, at its learned cost or else at its number."""
    assert record.best is not None
    space, best = record.scenario.space, record.best
    across = min(len(space), _ACROSS)
    down = -(-len(space) // across)
    figure = canvas(0.4 + 2.5 * down)
    grid = figure.subplots(down, across, squeeze=False)
    for axes in grid.flat[len(space) :]:
        axes.set_visible(False)
    learned = record.surrogate and slices_view(space, best.experiment.theta, record.thetas, record.surrogate)
    numbers = [trial.number for trial in record.trials]
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "clip_on": False}
    for k, (axes, knob) in enumerate(zip(grid.flat, space, strict=False)):
        if learned:
            x, y = learned[k]["x"], learned[k]["y"]
            axes.plot(x, y, color=BEST, linewidth=2)
            tried, height = learned[k]["samples"]["y"], np.interp(learned[k]["best"], x, y)
        else:
            tried, height = numbers, best.number
            axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.plot(record.thetas[:, k], tried, **dot, color=FAINT, alpha=0.5, ms=4, mew=0)
        theta = best.experiment.theta[k]
        axes.plot(theta, height, **dot, color=BEST, ms=8, mec="white", mew=1.2, zorder=5)
        axes.set_title(f"best {knob_number(knob, theta)}", color=BEST, fontweight="bold")
        _along(axes, knob)
    words = "learned cost, square root\n(0: the lowest shown)" if learned else "experiment"
    for axes in grid[:, 0]:
        axes.set_ylabel(words)
    return figure


def _along(axes: Axes, knob: Knob) -> None:
    """Show the whole range of a knob."""
    axes.set_xlabel(knob_axis(knob))
    if knob.scale == "log10":
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=knob.integer))
    axes.set_xlim(knob.low, knob.high)
