"""What the figures share: gap axes, panels, and lines that can be told apart."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from prefcal_scenarios.bench.results.campaign import HUGE
from prefcal_scenarios.bench.results.figures.looks import Look, drawn
from prefcal_scenarios.report.style import canvas


def panels(count: int, height: float = 1.75) -> tuple[Figure, list[Axes]]:
    """A figure with `count` panels of `height` inches, up to three in a row."""
    columns = 2 if count == 4 else min(count, 3)
    rows = -(-count // columns)
    figure = canvas((height if rows > 1 else 1.55 * height) * rows + 0.6)
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, grid[:count]


def line_options(look: Look) -> dict[str, Any]:
    """How a line of an agent looks."""
    return {
        "color": look.color, "linestyle": look.dashes, "marker": look.marker, "markersize": 4,
        "markeredgewidth": 0, "linewidth": 1.6,
    }  # fmt: skip


def markers(count: int, agent: int, agents: int) -> tuple[int, int]:
    """Where markers of a line with `count` points are, so that lines on each other show theirs."""
    every = max(count // 5, 1)
    return (agent * every // max(agents, 1), every)


def name_agents(figure: Figure, looks: Mapping[str, Look], extra: tuple[Line2D, ...] = ()) -> None:
    """One legend above the whole figure."""
    handles = [Line2D([], [], label=drawn(a), **line_options(look)) for a, look in looks.items()]
    longest = max((len(str(handle.get_label())) for handle in (*handles, *extra)), default=0)
    columns = max(1, min(len(handles) + len(extra), int(100 / (longest + 7))))
    rows = -(-(len(handles) + len(extra)) // columns)
    figure.set_figheight(figure.get_figheight() + 0.19 * (rows - 1))
    figure.legend(
        handles=[*handles, *extra], loc="outside upper left", ncols=columns, columnspacing=1.5,
        handlelength=2.2, handletextpad=0.6, borderaxespad=0.2,
    )  # fmt: skip


def gap_axis(axes: Axes, drawn: list[Float[np.ndarray, "..."]], floor: float) -> float:
    """Make the vertical axis a logarithmic one for all gaps of `drawn`.

    Returns:
        What gaps at the floor are to be drawn as: the lower end, where a tick says so. Zero has no
        place on a logarithm, and the floor itself may be decades below everything else.
    """
    values = np.concatenate([np.ravel(v) for v in drawn]) if drawn else np.array([1.0])
    values = values[np.isfinite(values) & (values < HUGE)]
    above = values[values > floor]
    low, high = (above.min(), above.max()) if len(above) else (floor, 1.0)
    axes.set_yscale("log")
    floored = bool(len(values)) and bool((values <= floor).any())
    decades = max(np.log10(high / low), 0.3)
    bottom = float(low / 10 ** (0.18 * decades if floored else 0.05 * decades))
    top = float(high * 10 ** (0.07 * decades))
    axes.set_ylim(bottom, top)
    ticks = _ticks(low if floored else bottom, top)
    labels = {bottom: f"≤{_power(floor)}"} if floored else {}
    axes.yaxis.set_major_locator(FixedLocator([*labels, *ticks]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: labels.get(v, _power(v))))
    return bottom


def _ticks(low: float, high: float) -> list[float]:
    """Powers of ten; where there are fewer than two, 2 and 5 times them too, or else any."""
    locators = (LogLocator(numticks=6), LogLocator(subs=(1, 2, 5), numticks=6), MaxNLocator(4))
    for locator in locators:
        ticks = [float(v) for v in locator.tick_values(low, high) if low <= v <= high]
        if len(ticks) > 1:
            break
    return ticks


def _power(value: float) -> str:
    if 0.009 < value < 1001:
        return f"{value:g}"
    mantissa, exponent = f"{value:.1e}".replace(".0e", "e").split("e")
    times = "" if mantissa == "1" else rf"{mantissa}\cdot"
    return rf"${times}10^{{{int(exponent)}}}$"
