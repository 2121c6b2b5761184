"""Draw figures with a row for each agent: ranks, final worth, times, and two heat maps."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from prefcal_bench.cells.duels import PAPER
from prefcal_bench.cells.roster import in_order
from prefcal_bench.results.curves import Setting
from prefcal_bench.results.duelling import Tally
from prefcal_bench.results.standing import Ranking
from prefcal_bench.results.statistics import random_search
from prefcal_bench.results.tables import Worths
from prefcal_bench.results.words import percent, plain_number
from prefcal_scenarios.presentation.style import FAINT, INK, canvas

from .drawing import Look, drawn, worth_axis

_DUEL = LinearSegmentedColormap.from_list(
    "duel", ["#b54f06", "#f0ab7a", "#f6f7f9", "#9cc3ea", "#0a5bad"]
)
"""Colors from always losing (orange) to always winning (blue)."""
_ROOMY = 9
"""Largest number of columns in which an interval fits."""


def heat_map(tallies: Sequence[Tally]) -> Figure:
    """Draw the share of seeds in which the row's θ is preferred to the column's, with counts.

    Args:
        tallies: All tallies of one problem and calibrator, one or more.
    """
    agents = in_order({t.agent for t in tallies})
    met = {t.rival for t in tallies}
    rivals = tuple(name for name in (PAPER, *in_order({*agents, *met} - {PAPER})) if name in met)
    places = {(t.agent, t.rival): (agents.index(t.agent), rivals.index(t.rival)) for t in tallies}
    net = np.full((len(agents), len(rivals)), np.nan)
    for t in tallies:
        net[places[t.agent, t.rival]] = t.net
    ticks = {-1.0: "column\nalways", 0.0: "even", 1.0: "row\nalways"}
    figure, axes = _map(net, [agents, rivals], ticks, height=0.46 * len(agents) + 1.3, level=4)
    for t in tallies:
        _write(axes, t, *places[t.agent, t.rival])
    return figure


def _map(
    values: Float[np.ndarray, "R C"],
    names: Sequence[Sequence[str]],
    ticks: Mapping[float, str],
    *,
    height: float,
    level: int,
) -> tuple[Figure, Axes]:
    """Draw a heat map without the texts in its cells.

    Args:
        values: Value of each cell, NaN without one.
        names: Names of the rows and of the columns.
        ticks: Values of the color bar with their meaning, from the lowest to the highest.
        height: Height of the figure in inches.
        level: Largest number of columns whose names fit side by side.
    """
    rows, columns = ([drawn(name) for name in some] for some in names)
    figure, size = canvas(height), 9.5 if level < 5 else 9
    axes = figure.subplots()
    image = axes.imshow(values, cmap=_DUEL, vmin=min(ticks), vmax=max(ticks), aspect="auto")
    axes.set_yticks(range(len(rows)), rows, color=INK, fontsize=size)
    axes.xaxis.tick_top()
    axes.set_xticks(range(len(columns)), columns, color=INK, fontsize=size)
    if len(columns) > level:
        for label in axes.get_xticklabels():
            label.set(rotation=24, ha="left", rotation_mode="anchor")
    axes.grid(False)
    axes.spines[:].set_visible(False)
    for line in np.arange(0.5, len(columns) - 1):
        axes.axvline(line, color="white", linewidth=2)
    for line in np.arange(0.5, len(rows) - 1):
        axes.axhline(line, color="white", linewidth=2)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=24, ticks=list(ticks))
    bar.ax.set_yticklabels(list(ticks.values()))
    bar.outline.set_visible(False)
    return figure, axes


def _write(axes: Axes, t: Tally, y: int, x: int) -> None:
    color = "white" if abs(t.net) > 0.85 else INK
    axes.text(x, y - 0.02, percent(t.share), ha="center", va="bottom", color=color, fontsize=10)
    axes.text(x, y + 0.08, f"{t.wins}–{t.ties}–{t.losses}", ha="center", va="top", color=color,
              fontsize=7.5, alpha=0.85)  # fmt: skip


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
        look = looks[agent]
        ranks, counts = np.unique(found.ranks[:, y], return_counts=True)
        axes.scatter(
            ranks, np.full(len(ranks), y), s=6 + 180 * counts / len(found.problems),
            color=look.color, alpha=0.35, linewidth=0, zorder=2,
        )  # fmt: skip
        axes.plot([average - half, average + half], [y, y], color=look.color, linewidth=3,
                  solid_capstyle="butt", zorder=3)  # fmt: skip
        _point(axes, (average, y), look, f"{average:.2f}")
    _name_rows(axes, found.agents)
    axes.set_xlim(min(0.8, best - half - 0.1), max(count + 0.2, found.average[-1] + half + 0.1))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=2, nbins=12))
    axes.set_xticks([t for t in axes.get_xticks() if 1 <= t <= count])
    axes.set_xlabel("average rank of the median gap at the end (1: the nearest)")
    axes.set_title(_title(found))
    axes.annotate("average", (1.01, -0.62), xycoords=axes.get_yaxis_transform(), va="bottom",
                  color=FAINT, fontsize=8.5)  # fmt: skip
    return figure


def _title(found: Ranking) -> str:
    test = "" if found.p is None else f"; Friedman's p {_bound(found.p)}"
    return f"{len(found.problems)} problems; critical difference {found.critical:.2f} (5 %){test}"


def _bound(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"= {p:.2g}"


_LEAST = 1e-7
"""Seconds below which a measured time reflects the clock, not a proposal."""


def seconds(measured: Mapping[str, Sequence[float]], looks: Mapping[str, Look]) -> Figure:
    """Draw the times of each agent: a dot for each problem, a line over the quartiles, the median.

    Args:
        measured: Median time of a proposal on each problem in seconds, by agent; one or more each.
        looks: Looks of the agents.
    """
    agents = sorted(measured, key=lambda a: (float(np.median(measured[a])), a))
    figure = canvas(0.36 * len(agents) + 1.0)
    axes = figure.subplots()
    for y, agent in enumerate(agents):
        values = np.maximum(np.array(measured[agent]), _LEAST)
        look = looks[agent]
        low, median, high = np.quantile(values, [0.25, 0.5, 0.75])
        axes.plot([low, high], [y, y], color=look.color, linewidth=5, alpha=0.35)
        axes.plot(values, np.full(len(values), y), "o", color=look.color, alpha=0.35, markersize=4,
                  markeredgewidth=0)  # fmt: skip
        _point(axes, (float(median), y), look, _time(float(median)))
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.set_xlim(low / 1.3, high * 1.3)  # ensures a tick even for a narrow range
    subs = (1.0,) if high / low > 1e3 else (1.0, 2.0, 5.0)
    axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: _time(v)))
    _name_rows(axes, agents)
    axes.set_xlabel("time of a proposal")
    return figure


def _time(value: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= 0.9995 * size:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"


def _point(axes: Axes, place: tuple[float, int], look: Look, text: str) -> None:
    """Draw an agent's marker, and its value to the right of the row."""
    axes.plot(*place, marker=look.marker, linestyle="none", color=look.color, markersize=9,
              markeredgecolor="white",
              markeredgewidth=1.2, zorder=4)  # fmt: skip
    axes.annotate(text, (1.01, place[1]), xycoords=axes.get_yaxis_transform(), va="center",
                  color=INK)  # fmt: skip


def _name_rows(axes: Axes, agents: Sequence[str], size: float = 9.5) -> None:
    axes.set_yticks(range(len(agents)), [drawn(a) for a in agents], color=INK, fontsize=size)
    axes.set_ylim(len(agents) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)


def summary(worths: Worths, settings: Sequence[Setting], looks: Mapping[str, Look]) -> Figure:
    """Draw a panel for each setting with the final worth of each agent, the highest on top.

    Args:
        worths: Worth of all studies.
        settings: Settings to draw, one or more.
        looks: Looks of the agents.
    """
    ends = {s: worths.ranked(s) for s in settings}
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
        _ends(axes, ends[settings[i]], looks)
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


def _limits(ends: pd.DataFrame, theory: float) -> tuple[float, float]:
    low = ends["worth_low"].fillna(ends["worth"]).astype(float).min()
    high = ends["worth_high"].fillna(ends["worth"]).astype(float).max()
    return (max(0.9, min(low, theory) / 1.25), max(high, theory) * 1.25)


def _ends(axes: Axes, ends: pd.DataFrame, looks: Mapping[str, Look]) -> None:
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
    _name_rows(axes, list(ends["agent"]), 8.5)


def improvements(worths: Worths, settings: Sequence[Setting]) -> Figure:
    """Draw the probability that the row's agent beats the baseline, with its interval.

    Args:
        worths: Worth of all studies, in which at least one of `settings` has an improvement.
        settings: Settings to draw, one column each.
    """
    ends = pd.concat([worths.ended(s) for s in settings])
    ends = ends[ends["improvement"].notna()]
    agents = in_order(ends["agent"])
    shown = [s for s in settings if (ends["setting"] == s).any()]
    places = {(row.agent, row.setting): row for row in ends.itertuples()}
    values = np.array([[places[a, s].improvement if (a, s) in places else np.nan for s in shown]
                       for a in agents])  # fmt: skip
    names = [agents, [s.name(settings) for s in shown]]
    ticks = {0.0: "always\nworse", 0.5: "even", 1.0: "always\nbetter"}
    figure, axes = _map(values, names, ticks, height=0.36 * len(agents) + 1.1, level=6)
    for (agent, setting), row in places.items():
        place = (shown.index(setting), agents.index(agent))
        _write_chance(axes, row, place, roomy=len(shown) <= _ROOMY)
    return figure


def _write_chance(axes: Axes, row: Any, place: tuple[int, int], *, roomy: bool) -> None:
    """Write a cell of the heat map; bold if its interval excludes an even chance."""
    x, y = place
    sure = (
        row.improvement_low is not None and not row.improvement_low <= 0.5 <= row.improvement_high
    )
    color = "white" if abs(row.improvement - 0.5) > 0.42 else INK
    text = f"{100 * row.improvement:.0f}"
    axes.text(
        x, y - 0.02 if roomy else y, f"{text} %" if roomy else text, ha="center",
        va="bottom" if roomy else "center", color=color, fontsize=9,
        fontweight="bold" if sure else "normal",
    )  # fmt: skip
    if row.improvement_low is not None and roomy:
        ends = f"{100 * row.improvement_low:.0f}–{100 * row.improvement_high:.0f}"
        axes.text(x, y + 0.04, ends, ha="center", va="top", color=color, fontsize=7, alpha=0.85)
