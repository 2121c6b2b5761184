"""Elements that the figures share: the style of each agent, gap axes, panels and legends."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain, cycle
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from prefcal_bench.cells.roster import in_order
from prefcal_scenarios.style import BEST, FIRST, GOOD, OTHERS, canvas
from prefcal_scenarios.wording import printable

from .campaign import HUGE
from .statistics import FLOOR
from .words import short_name


@dataclass(frozen=True, slots=True)
class AgentStyle:
    """Color, marker and dashes of an agent; the marker identifies it without color."""

    color: str
    marker: str
    dashes: tuple[int, tuple[int, ...]] | str = "-"

    @property
    def scale(self) -> float:
        """Return how much larger its marker is drawn than others: a star has little area."""
        return 1.8 if self.marker == "*" else 1.0


_DOTTED, _DASHED = (0, (1, 1)), (0, (4, 2))
_KNOWN: Mapping[str, AgentStyle] = {
    "Screening": AgentStyle("#00838f", "*"),
    "GLISp": AgentStyle(BEST, "o"),
    "GLISp.paper": AgentStyle("#56b4e9", "s"),
    "GLIS": AgentStyle(OTHERS[0], "D"),
    "PPO": AgentStyle(GOOD, "P"),
    "SAC": AgentStyle("#c0609a", "X"),
    "ReferenceGLISp": AgentStyle("#8a4fb0", "<"),
    "ReferenceGLIS": AgentStyle("#7a2e04", "p"),
    "OptunaPreferential": AgentStyle("#b88a00", ">"),
    "EUBO": AgentStyle("#2e6f57", "8"),
    "BOPE": AgentStyle("#d1495b", "H"),
    "OptunaTPE": AgentStyle("#6b7f2a", "d"),
    "OptunaGP": AgentStyle("#a0522d", "h"),
    "EqualWeights": AgentStyle("#94b000", "d", _DASHED),
    "StepSearch": AgentStyle("#cf2b4a", "8"),
    "LatinHypercube": AgentStyle("#4b5563", "^", _DASHED),
    "RandomSearch": AgentStyle(FIRST, "v", _DOTTED),
}
"""Agents that come with the project; those with dashed or dotted lines do not learn."""
_SPARE = (AgentStyle("#e58fb5", "h"), AgentStyle("#1c2f7a", "H"), AgentStyle("#b49ae6", "p"))


def drawn(name: str) -> str:
    """Return a name that matplotlib draws literally: not a formula, and visible in a legend.

    A user's own agent is shortened to the last part of its path.
    """
    text = printable(short_name(name)).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def agent_styles(agents: Iterable[str]) -> dict[str, AgentStyle]:
    """Return a style for each agent; a user's own agent gets an unused one if possible."""
    names = in_order(agents)
    absent = [style for name, style in _KNOWN.items() if name not in names and style.dashes == "-"]
    free = [*_SPARE, *absent]
    spare = chain(free, cycle([replace(style, dashes=_DASHED) for style in free]))
    return {name: _KNOWN[name] if name in _KNOWN else next(spare) for name in names}


def panels(count: int, height: float = 1.75) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` panels of `height` inches, up to three in a row."""
    columns = 2 if count == 4 else min(count, 3)
    rows = -(-count // columns)
    figure = canvas((height if rows > 1 else 1.55 * height) * rows + 0.6)
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, grid[:count]


def line_options(style: AgentStyle) -> dict[str, Any]:
    """Return the options of an agent's line."""
    return {
        "color": style.color,
        "linestyle": style.dashes,
        "marker": style.marker,
        "markersize": 4 * style.scale,
        "markeredgewidth": 0,
        "linewidth": 1.6,
    }


def markers(count: int, agent: int, agents: int) -> tuple[int, int]:
    """Return the positions of a line's markers, staggered so that overlapping lines show theirs."""
    every = max(count // 5, 1)
    return (agent * every // max(agents, 1), every)


def name_agents(figure: Figure, styles: Mapping[str, AgentStyle], extra: tuple[Line2D, ...] = ()) -> None:
    """Draw one legend above the whole figure."""
    handles = [Line2D([], [], label=drawn(a), **line_options(style)) for a, style in styles.items()]
    longest = max((len(str(handle.get_label())) for handle in (*handles, *extra)), default=0)
    columns = max(1, min(len(handles) + len(extra), int(100 / (longest + 7))))
    rows = -(-(len(handles) + len(extra)) // columns)
    figure.set_figheight(figure.get_figheight() + 0.19 * (rows - 1))
    figure.legend(
        handles=[*handles, *extra],
        loc="outside upper left",
        ncols=columns,
        columnspacing=1.5,
        handlelength=2.2,
        handletextpad=0.6,
        borderaxespad=0.2,
    )


def gap_axis(axes: Axes, *drawn: Mapping[str, Float[np.ndarray, "..."]]) -> float:
    """Make the vertical axis logarithmic, with limits that fit all gaps of `drawn`.

    Returns:
        The value at which to draw gaps at the floor: the lower end, which a tick labels. Zero has
        no place on a logarithmic axis, and the floor itself can be decades below all other gaps.
    """
    values = np.concatenate([np.ravel(gaps) for some in drawn for gaps in some.values()])
    values = values[np.isfinite(values) & (values < HUGE)]
    above = values[values > FLOOR]
    low, high = (above.min(), above.max()) if len(above) else (FLOOR, 1.0)
    axes.set_yscale("log")
    floored = bool(len(values)) and bool((values <= FLOOR).any())
    decades = max(np.log10(high / low), 0.3)
    bottom = float(low / 10 ** (0.18 * decades if floored else 0.05 * decades))
    top = float(high * 10 ** (0.07 * decades))
    axes.set_ylim(bottom, top)
    ticks = _ticks(low if floored else bottom, top)
    labels = {bottom: f"≤{_power(FLOOR)}"} if floored else {}
    axes.yaxis.set_major_locator(FixedLocator([*labels, *ticks]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: labels.get(v, _power(v))))
    return bottom


def _ticks(low: float, high: float) -> list[float]:
    """Return powers of ten as ticks; if fewer than two fit, add 2 and 5 times them, or any."""
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


def worth_axis(axes: Axes, limits: tuple[float, float], which: str) -> None:
    """Make the axis "x" or "y" logarithmic, with plain numbers at 1, 10, 100, ..."""
    axes.set(**{f"{which}scale": "log", f"{which}lim": limits})
    span = limits[1] / limits[0]
    subs = (1.0,) if span > 100 else (1.0, 3.0) if span > 30 else (1.0, 2.0, 5.0)
    ticks = [s * 10.0**k for k in range(5) for s in subs]
    axis = axes.yaxis if which == "y" else axes.xaxis
    axis.set_major_locator(FixedLocator([t for t in ticks if limits[0] <= t <= limits[1]]))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
