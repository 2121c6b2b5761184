"""Draw figures with a row for each agent: ranks, and final worth."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from prefcal_bench.results.campaign import Campaign, Setting
from prefcal_bench.results.rows import ended
from prefcal_bench.results.standing import Ranking
from prefcal_bench.results.statistics import random_search
from prefcal_bench.results.words import plain_number, probability, with_interval
from prefcal_scenarios.presentation.style import FAINT, INK, canvas

from .drawing import Look, drawn, worth_axis


def ranking(found: Ranking, looks: Mapping[str, Look]) -> Figure:
    """Draw each agent's average rank, half a critical difference to each side, and its ranks.

    Two agents whose bars do not overlap differ significantly.
    """
    count = len(found.agents)
    figure = canvas(0.36 * count + 1.15)
    axes = figure.subplots()
    half = found.critical / 2
    best = found.average[0]
    axes.axvspan(best - half, best + half, color="#eef1f4", linewidth=0, zorder=0)
    for y, (agent, average) in enumerate(zip(found.agents, found.average, strict=True)):
        ranks, counts = np.unique(found.ranks[:, y], return_counts=True)
        axes.scatter(
            ranks, np.full(len(ranks), y), s=6 + 180 * counts / len(found.problems),
            color=looks[agent].color, alpha=0.35, linewidth=0, zorder=2,
        )  # fmt: skip
        ends = (average - half, average + half)
        _row(axes, y, looks[agent], average, ends, f"{average:.2f}")
    _name_rows(axes, found.agents)
    axes.set_xlim(min(0.8, best - half - 0.1), max(count + 0.2, found.average[-1] + half + 0.1))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=2, nbins=12))
    axes.set_xticks([t for t in axes.get_xticks() if 1 <= t <= count])
    axes.set_xlabel("average rank of the median gap at the end (1: the nearest)")
    test = "" if found.p is None else f"; Friedman's p {probability(found.p)}"
    problems, critical = len(found.problems), found.critical
    axes.set_title(f"{problems} problems; critical difference {critical:.2f} (5 %){test}")
    return figure


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
    for y, row in enumerate(ends.itertuples()):
        bar = (row.worth, row.worth) if row.worth_low is None else (row.worth_low, row.worth_high)
        text = with_interval(row.worth, row.worth_low, row.worth_high)
        _row(axes, y, looks[row.agent], row.worth, bar, text, hollow=row.answers == 0, size=8)
    _name_rows(axes, list(ends["agent"]), 8.5)


def _row(
    axes: Axes,
    y: int,
    look: Look,
    value: float,
    ends: tuple[float, float],
    text: str,
    *,
    hollow: bool = False,
    size: float = 9.5,
) -> None:
    """Draw an agent's marker, a bar between two ends, and its value to the right of the row."""
    axes.plot(ends, [y, y], color=look.color, linewidth=2.6, solid_capstyle="butt", zorder=3)
    axes.plot(
        value, y, marker=look.marker, linestyle="none", zorder=4, markersize=7,
        color="white" if hollow else look.color, markeredgewidth=1.2,
        markeredgecolor=look.color if hollow else "white",
    )  # fmt: skip
    where = axes.get_yaxis_transform()
    axes.annotate(text, (1.02, y), xycoords=where, va="center", color=INK, fontsize=size)


def _name_rows(axes: Axes, agents: Sequence[str], size: float = 9.5) -> None:
    axes.set_yticks(range(len(agents)), [drawn(a) for a in agents], color=INK, fontsize=size)
    axes.set_ylim(len(agents) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)
