"""Draw figures with a row for each agent: average ranks, duels, and times of proposals."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from prefcal_scenarios.app.presentation.style import FAINT, INK, canvas
from prefcal_scenarios.bench.duels import PAPER
from prefcal_scenarios.bench.results.duelling import Tally
from prefcal_scenarios.bench.results.ranking import Ranking
from prefcal_scenarios.bench.results.words import percent
from prefcal_scenarios.bench.roster import in_order

from .drawing import Look, drawn

DUEL = LinearSegmentedColormap.from_list(
    "duel", ["#b54f06", "#f0ab7a", "#f6f7f9", "#9cc3ea", "#0a5bad"]
)
"""Colors from always losing (orange) to always winning (blue)."""
_LEVEL = 4
"""Largest number of columns whose names fit side by side."""


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


def _name_rows(axes: Axes, agents: Sequence[str]) -> None:
    axes.set_yticks(range(len(agents)), [drawn(a) for a in agents], color=INK, fontsize=9.5)
    axes.set_ylim(len(agents) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)
