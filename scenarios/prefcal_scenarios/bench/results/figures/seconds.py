"""Figure: seconds that a proposal takes."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from prefcal_scenarios.bench.results.figures.looks import Look, drawn
from prefcal_scenarios.report.style import INK, canvas

_LEAST = 1e-7
"""Seconds: less is no proposal's time but a clock's."""


def seconds(measured: Mapping[str, Sequence[float]], looks: Mapping[str, Look]) -> Figure:
    """One row for each agent: a dot for each problem, a line over their quartiles, their median.

    Args:
        measured: Median seconds of a proposal on each problem, by agent; one or more each.
        looks: Of the agents.
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
        axes.plot(median, y, look.marker, color=look.color, markersize=9, markeredgecolor="white",
                  markeredgewidth=1.2, zorder=4)  # fmt: skip
        axes.annotate(_time(float(median)), (1.01, y), xycoords=axes.get_yaxis_transform(),
                      va="center", color=INK)  # fmt: skip
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.set_xlim(low / 1.3, high * 1.3)  # so that there is a tick, however narrow the range
    subs = (1.0,) if high / low > 1e3 else (1.0, 2.0, 5.0)
    axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: _time(v)))
    axes.set_yticks(range(len(agents)), [drawn(a) for a in agents], color=INK, fontsize=9.5)
    axes.set_ylim(len(agents) - 0.4, -0.6)
    axes.set_xlabel("time of a proposal")
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)
    return figure


def _time(value: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= 0.9995 * size:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"
