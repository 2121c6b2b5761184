"""Figure: who is preferred to whom, where there is no cost."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from prefcal_scenarios.bench.duels import PAPER
from prefcal_scenarios.bench.results.duelling import Tally
from prefcal_scenarios.bench.results.figures.looks import drawn
from prefcal_scenarios.bench.results.order import in_order
from prefcal_scenarios.bench.results.words import percent
from prefcal_scenarios.report.style import INK, canvas

DUEL = LinearSegmentedColormap.from_list(
    "duel", ["#b54f06", "#f0ab7a", "#f6f7f9", "#9cc3ea", "#0a5bad"]
)
"""From always losing (orange) to always winning (blue)."""
_LEVEL = 4
"""Columns whose names have room beside each other."""


def heat_map(tallies: Sequence[Tally]) -> Figure:
    """Share of seeds in which the row's θ is preferred to the column's; wins, ties, losses below.

    Args:
        tallies: All of one problem and calibrator, one or more.
    """
    agents = in_order({t.agent for t in tallies})
    met = {t.rival for t in tallies}
    rivals = tuple(name for name in (PAPER, *in_order({*agents, *met} - {PAPER})) if name in met)
    places = {(t.agent, t.rival): (agents.index(t.agent), rivals.index(t.rival)) for t in tallies}
    net = np.full((len(agents), len(rivals)), np.nan)
    for t in tallies:
        net[places[t.agent, t.rival]] = t.net
    figure = canvas(0.46 * len(agents) + 1.3)
    axes = figure.subplots()
    image = axes.imshow(net, cmap=DUEL, vmin=-1, vmax=1, aspect="auto")
    for t in tallies:
        _write(axes, t, *places[t.agent, t.rival])
    axes.set_yticks(range(len(agents)), [drawn(a) for a in agents], color=INK, fontsize=9.5)
    axes.xaxis.tick_top()
    axes.set_xticks(range(len(rivals)), [drawn(r) for r in rivals], color=INK, fontsize=9.5)
    if len(rivals) > _LEVEL:
        for label in axes.get_xticklabels():
            label.set(rotation=24, ha="left", rotation_mode="anchor")
    axes.grid(False)
    axes.spines[:].set_visible(False)
    for line in np.arange(0.5, len(rivals) - 1):
        axes.axvline(line, color="white", linewidth=2)
    for line in np.arange(0.5, len(agents) - 1):
        axes.axhline(line, color="white", linewidth=2)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=24, ticks=[-1, 0, 1])
    bar.ax.set_yticklabels(["column\nalways", "even", "row\nalways"])
    bar.outline.set_visible(False)
    return figure


def _write(axes: Axes, t: Tally, y: int, x: int) -> None:
    color = "white" if abs(t.net) > 0.85 else INK
    axes.text(x, y - 0.02, percent(t.share), ha="center", va="bottom", color=color, fontsize=10)
    axes.text(x, y + 0.08, f"{t.wins}–{t.ties}–{t.losses}", ha="center", va="top", color=color,
              fontsize=7.5, alpha=0.85)  # fmt: skip
