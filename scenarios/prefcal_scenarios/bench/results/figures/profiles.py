"""Figure: data profiles."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from prefcal_scenarios.bench.results.figures.axes import line_options, markers, name_agents, panels
from prefcal_scenarios.bench.results.figures.looks import Look
from prefcal_scenarios.bench.results.profiles import Profiles


def data_profiles(found: Profiles, looks: Mapping[str, Look]) -> Figure:
    """One panel for each tolerance: share of (problem, seed) solved, against experiments."""
    figure, grid = panels(len(found.shares))
    present = {a: looks[a] for a in looks if a in next(iter(found.shares.values()))}
    for axes, (tolerance, shares) in zip(grid, found.shares.items(), strict=True):
        for i, agent in reversed(list(enumerate(present))):
            x = np.arange(1, len(shares[agent]) + 1)
            axes.plot(
                x, 100 * shares[agent], label=agent, drawstyle="steps-post",
                markevery=markers(len(x), i, len(present)), clip_on=False,
                **line_options(present[agent]),
            )  # fmt: skip
        axes.set_ylim(0, 100)
        axes.set_xlim(0.5, found.regime.n_max + 0.5)
        axes.set_title(f"to {100 * tolerance:g} % of the initial gap")
        axes.yaxis.set_major_formatter(PercentFormatter(decimals=0))
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.grid(False, axis="x")
    for axes in grid[1:]:
        axes.tick_params(labelleft=False)
    figure.supxlabel("experiments", fontsize=9.5)
    grid[0].set_ylabel("solved (problem, seed)")
    name_agents(figure, present)
    return figure
