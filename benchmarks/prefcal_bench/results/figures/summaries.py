"""Draw the final worth with a row for each agent."""

from collections.abc import Mapping, Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_bench.results.campaign import Campaign, Setting
from prefcal_bench.results.rows import ended
from prefcal_bench.results.statistics import random_search
from prefcal_bench.results.words import plain_number, with_interval
from prefcal_scenarios.presentation.style import FAINT, INK, canvas

from .drawing import Look, drawn, worth_axis


def summary(
    campaign: Campaign, rows: pd.DataFrame, settings: Sequence[Setting], looks: Mapping[str, Look]
) -> Figure:
    """Draw a panel for each setting with the final worth of each agent, the highest on top.

    Args:
        campaign: All results.
        rows: Table of worth, see `worth_rows`.
        settings: Settings to draw, one or more.
        looks: Looks of the agents.
    """
    ends = {s: ended(rows, s) for s in settings}
    columns = min(len(settings), 2)
    lines = [settings[i : i + columns] for i in range(0, len(settings), columns)]
    heights = [max(len(ends[s]) for s in line) for line in lines]
    figure = canvas(sum(0.2 * h + 0.42 for h in heights) + 0.6)
    ratios = [h + 1 for h in heights]
    grid = figure.subplots(len(lines), columns, squeeze=False, height_ratios=ratios)
    theories = {s: random_search(s.n_max) for s in settings}
    limits = _limits(pd.concat(ends.values()), max(theories.values()))
    for axes in grid.flat[len(settings) :]:
        axes.set_axis_off()
    for axes, setting in zip(grid.flat, settings, strict=False):
        _draw_ends(axes, ends[setting], looks)
        axes.axvline(theories[setting], color=FAINT, linewidth=1, linestyle="--", zorder=1)
        axes.set_title(drawn(setting.name(campaign.having("worth"))), fontweight="bold")
        worth_axis(axes, limits, "x")
    budgets = " and ".join(map(str, sorted({s.n_max for s in settings})))
    theory = " and ".join(plain_number(value) for value in sorted(set(theories.values())))
    figure.supxlabel(
        f"worth of the θ after {budgets} experiments, in random experiments\n"
        f"dashed: random search in theory, {theory}; hollow: told values",
        fontsize=9,
    )
    return figure


def _limits(ends: pd.DataFrame, theory: float) -> tuple[float, float]:
    low = ends["worth_low"].fillna(ends["worth"]).astype(float).min()
    high = ends["worth_high"].fillna(ends["worth"]).astype(float).max()
    return (max(0.9, min(low, theory) / 1.25), max(high, theory) * 1.25)


def _draw_ends(axes: Axes, ends: pd.DataFrame, looks: Mapping[str, Look]) -> None:
    """Draw each agent's marker, its interval, and its value to the right of the row."""
    where = axes.get_yaxis_transform()
    for y, row in enumerate(ends.itertuples()):
        look = looks[row.agent]
        if row.worth_low is not None:
            axes.plot([row.worth_low, row.worth_high], [y, y], color=look.color, linewidth=2.4,
                      solid_capstyle="butt", zorder=3)  # fmt: skip
        sees = row.answers == 0
        axes.plot(
            row.worth, y, marker=look.marker, linestyle="none", zorder=4, markersize=7,
            color="white" if sees else look.color, markeredgewidth=1.2,
            markeredgecolor=look.color if sees else "white",
        )  # fmt: skip
        text = with_interval(row.worth, row.worth_low, row.worth_high)
        axes.annotate(text, (1.02, y), xycoords=where, va="center", color=INK, fontsize=8)
    names = [drawn(agent) for agent in ends["agent"]]
    axes.set_yticks(range(len(names)), names, color=INK, fontsize=8.5)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)
