"""Draw the worth that each agent ends with, and how likely it is to beat the baseline."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_scenarios.app.presentation.style import FAINT, INK, canvas
from prefcal_scenarios.bench.results.figures.drawing import Look, drawn
from prefcal_scenarios.bench.results.figures.summaries import DUEL
from prefcal_scenarios.bench.roster import in_order

from .curves import Setting
from .lines import worth_axis
from .statistics import random_search
from .words import plain_number

_LEVEL = 6
"""Largest number of columns whose names fit side by side."""
_ROOMY = 9
"""Largest number of columns in which an interval fits."""


def summary(rows: pd.DataFrame, settings: Sequence[Setting], looks: Mapping[str, Look]) -> Figure:
    """Draw a panel for each setting with the final worth of each agent, the highest on top.

    Args:
        rows: Table of worth, see `worth_rows`.
        settings: Settings to draw, one or more.
        looks: Looks of the agents.
    """
    ends = {s: ended(rows, s).sort_values("worth", ascending=False) for s in settings}
    columns = min(len(settings), 2)
    lines = [list(settings[i : i + columns]) for i in range(0, len(settings), columns)]
    heights = [max(len(ends[s]) for s in line) for line in lines]
    figure = canvas(sum(0.2 * h + 0.42 for h in heights) + 0.6)
    grid = figure.subplots(
        len(lines), columns, squeeze=False, height_ratios=[h + 1 for h in heights]
    )
    theory = max(random_search(s.n_max) for s in settings)
    limits = _limits(pd.concat(list(ends.values())), theory)
    names = [s.name(settings) for s in settings]
    for i, axes in enumerate(grid.flat):
        if i >= len(settings):
            axes.set_axis_off()
            continue
        _worths(axes, ends[settings[i]], looks)
        axes.axvline(random_search(settings[i].n_max), color=FAINT, linewidth=1,
                     linestyle=(0, (4, 2)), zorder=1)  # fmt: skip
        axes.set_title(drawn(names[i]), fontweight="bold")
        worth_axis(axes, limits, vertical=False)
    budgets = sorted({s.n_max for s in settings})
    theories = [plain_number(random_search(n)) for n in budgets]
    figure.supxlabel(
        f"worth of the θ after {_listed(budgets)} experiments, in random experiments\n"
        f"dashed: random search in theory, {_listed(theories)}; hollow: told values",
        fontsize=9,
    )
    return figure


def _listed(values: Sequence[object]) -> str:
    return " and ".join(map(str, values))


def ended(rows: pd.DataFrame, setting: Setting) -> pd.DataFrame:
    """Return the rows of a setting after all its experiments."""
    last = (rows["unit"] == "experiments") & (rows["after"] == setting.n_max)
    return rows[(rows["setting"] == setting) & last]


def _limits(ends: pd.DataFrame, theory: float) -> tuple[float, float]:
    low = ends["worth_low"].fillna(ends["worth"]).astype(float).min()
    high = ends["worth_high"].fillna(ends["worth"]).astype(float).max()
    return (max(0.9, min(low, theory) / 1.25), max(high, theory) * 1.25)


def _worths(axes: Axes, ends: pd.DataFrame, looks: Mapping[str, Look]) -> None:
    for y, row in enumerate(ends.itertuples()):
        look = looks[row.agent]
        text = plain_number(row.worth)
        if row.worth_low is not None:
            axes.plot([row.worth_low, row.worth_high], [y, y], color=look.color, linewidth=2.4,
                      solid_capstyle="butt", zorder=3)  # fmt: skip
            text += f"  ({plain_number(row.worth_low)}–{plain_number(row.worth_high)})"
        sees = row.answers == 0
        axes.plot(row.worth, y, marker=look.marker, linestyle="none", zorder=4,
                  markersize=9 if look.marker == "*" else 6.5,
                  color="white" if sees else look.color, markeredgewidth=1.4 if sees else 0.5,
                  markeredgecolor=look.color if sees else "white")  # fmt: skip
        axes.annotate(text, (1.02, y), xycoords=axes.get_yaxis_transform(), va="center",
                      color=INK, fontsize=8)  # fmt: skip
    axes.set_yticks(range(len(ends)), [drawn(a) for a in ends["agent"]], color=INK, fontsize=8.5)
    axes.set_ylim(len(ends) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)


def improvements(rows: pd.DataFrame, settings: Sequence[Setting]) -> Figure:
    """Draw the probability that the row's agent beats the baseline, with its interval.

    Args:
        rows: Table of worth in which at least one of `settings` has an improvement.
        settings: Settings to draw, one column each.
    """
    ends = pd.concat([ended(rows, s) for s in settings])
    ends = ends[ends["improvement"].notna()]
    agents = in_order(ends["agent"])
    shown = [s for s in settings if (ends["setting"] == s).any()]
    values = np.full((len(agents), len(shown)), np.nan)
    figure = canvas(0.36 * len(agents) + 1.1)
    axes = figure.subplots()
    for row in ends.itertuples():
        y, x = agents.index(row.agent), shown.index(row.setting)
        values[y, x] = row.improvement
        _write(axes, row, (x, y), len(shown))
    image = axes.imshow(values, cmap=DUEL, vmin=0, vmax=1, aspect="auto")
    names = [drawn(s.name(settings)) for s in shown]
    axes.set_yticks(range(len(agents)), [drawn(a) for a in agents], color=INK, fontsize=9)
    axes.xaxis.tick_top()
    axes.set_xticks(range(len(shown)), names, color=INK, fontsize=9)
    if len(shown) > _LEVEL:
        for label in axes.get_xticklabels():
            label.set(rotation=24, ha="left", rotation_mode="anchor")
    axes.grid(False)
    axes.spines[:].set_visible(False)
    axes.set_xticks(np.arange(0.5, len(shown) - 1), minor=True)
    axes.set_yticks(np.arange(0.5, len(agents) - 1), minor=True)
    axes.tick_params(which="minor", length=0)
    axes.grid(True, which="minor", color="white", linewidth=2)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=24, ticks=[0, 0.5, 1])
    bar.ax.set_yticklabels(["always\nworse", "even", "always\nbetter"])
    bar.outline.set_visible(False)
    return figure


def _write(axes: Axes, row: Any, place: tuple[int, int], columns: int) -> None:
    """Write a cell of the heat map; bold if its interval excludes an even chance."""
    x, y = place
    sure = (
        row.improvement_low is not None and not row.improvement_low <= 0.5 <= row.improvement_high
    )
    color = "white" if abs(row.improvement - 0.5) > 0.42 else INK
    text, roomy = f"{100 * row.improvement:.0f}", columns <= _ROOMY
    axes.text(
        x, y - 0.02 if roomy else y, f"{text} %" if roomy else text, ha="center",
        va="bottom" if roomy else "center", color=color, fontsize=9,
        fontweight="bold" if sure else "normal",
    )  # fmt: skip
    if row.improvement_low is not None and roomy:
        ends = f"{100 * row.improvement_low:.0f}–{100 * row.improvement_high:.0f}"
        axes.text(x, y + 0.04, ends, ha="center", va="top", color=color, fontsize=7, alpha=0.85)
