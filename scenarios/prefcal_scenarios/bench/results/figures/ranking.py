"""Figure: average ranks with critical-difference bars."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from prefcal_scenarios.bench.results.figures.looks import Look, drawn
from prefcal_scenarios.bench.results.ranking import Ranking
from prefcal_scenarios.report.style import FAINT, INK, canvas


def ranking(found: Ranking, looks: Mapping[str, Look]) -> Figure:
    """One row for each agent: its average rank, half a critical difference each way, its ranks.

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
        axes.plot(average, y, look.marker, color=look.color, markersize=9, markeredgecolor="white",
                  markeredgewidth=1.2, zorder=4)  # fmt: skip
        axes.annotate(f"{average:.2f}", (1.01, y), xycoords=axes.get_yaxis_transform(),
                      va="center", color=INK)  # fmt: skip
    axes.set_yticks(range(count), [drawn(a) for a in found.agents], color=INK, fontsize=9.5)
    axes.set_ylim(count - 0.4, -0.6)
    axes.set_xlim(min(0.8, best - half - 0.1), max(count + 0.2, found.average[-1] + half + 0.1))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=2, nbins=12))
    axes.set_xticks([t for t in axes.get_xticks() if 1 <= t <= count])
    axes.set_xlabel("average rank of the median gap at the end (1: the nearest)")
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.set_title(_title(found))
    axes.annotate("average", (1.01, -0.62), xycoords=axes.get_yaxis_transform(), va="bottom",
                  color=FAINT, fontsize=8.5)  # fmt: skip
    return figure


def _title(found: Ranking) -> str:
    test = "" if found.p is None else f"; Friedman's p {_bound(found.p)}"
    return f"{len(found.problems)} problems; critical difference {found.critical:.2f} (5 %){test}"


def _bound(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"= {p:.2g}"
