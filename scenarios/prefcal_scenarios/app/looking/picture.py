"""Draw two runs over each other, a panel per signal."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.app.presentation.style import BEST, GOOD, OTHERS, canvas, legend
from prefcal_scenarios.app.presentation.wording import printable
from prefcal_scenarios.app.report.trajectories import Curve, draw, draw_limits, panel_title
from prefcal_scenarios.app.web.view.panels import reference_of

from .pair import Pair


def overlay(pair: Pair) -> Figure:
    """Draw both runs over each other; references are dotted."""
    rows = max(len(pair.panels), 1)
    figure = canvas(0.7 + 1.75 * rows)
    grid = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    looks = ((BEST, "-"), (OTHERS[0], (0, (5, 1.6))))
    for i, (place, panel) in enumerate(zip(grid, pair.panels, strict=False)):
        draw_limits(place, panel.channel)
        for (run, plots), (color, dashes) in zip(pair.sides, looks, strict=True):
            _reference(place, plots[i], run.experiment)
            label = _plain(run.name)
            draw(place, plots[i], Curve(run.experiment, label, color, 1.7, dashes))
        place.set_title(_plain(panel_title(panel.channel)))
        place.margins(x=0.01)
    unit = pair.left.experiment.channels.time_unit
    grid[-1].set_xlabel(_plain(f"time [{unit}]" if unit else "time"))
    legend(figure, grid[0], 2)
    return figure


def _plain(text: str) -> str:
    """Return text for matplotlib, which would read a formula between two dollar signs."""
    return printable(text).replace("$", r"\$")


def _reference(axes: Axes, plot: Plot, experiment: Experiment) -> None:
    values = reference_of(plot, experiment)
    if values is None or not np.isfinite(values).any():
        return
    axes.plot(experiment.t, values, color=GOOD, linewidth=0.9, linestyle=(0, (1, 2)),
              drawstyle="steps-post")  # fmt: skip
