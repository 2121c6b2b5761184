"""Elements that the figures share: the look of each agent, gap axes, panels and legends."""

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
from prefcal_scenarios.presentation.style import BEST, FIRST, GOOD, OTHERS, canvas
from prefcal_scenarios.presentation.wording import printable

from .campaign import HUGE
from .statistics import FLOOR
from .words import short_name


@dataclass(frozen=True, slots=True)
class Look:
    """Color, marker and dashes of an agent; the marker identifies it without color."""

    color: str
    marker: str
    dashes: tuple[int, tuple[int, ...]] | str = "-"


_DOTTED, _DASHED = (0, (1, 1)), (0, (4, 2))
_KNOWN: Mapping[str, Look] = {
    "GLISp": Look(BEST, "o"),
    "GLISp.paper": Look("#56b4e9", "s"),
    "GLIS": Look(OTHERS[0], "D"),
    "PPO": Look(GOOD, "P"),
    "SAC": Look("#c0609a", "X"),
    "ReferenceGLISp": Look("#8a4fb0", "<"),
    "ReferenceGLIS": Look("#7a2e04", "p"),
    "OptunaPreferential": Look("#b88a00", ">"),
    "EUBO": Look("#2e6f57", "8"),
    "BOPE": Look("#d1495b", "H"),
    "OptunaTPE": Look("#6b7f2a", "d"),
    "OptunaGP": Look("#a0522d", "h"),
    "LatinHypercube": Look("#4b5563", "^", _DASHED),
    "RandomSearch": Look(FIRST, "v", _DOTTED),
}
"""Agents that come with the project; those with dashed or dotted lines do not learn."""
_SPARE = (
    Look("#00a3a3", "*"),
    Look("#e58fb5", "h"),
    Look("#94b000", "d"),
    Look("#1c2f7a", "H"),
    Look("#cf2b4a", "8"),
    Look("#b49ae6", "p"),
)


def drawn(name: str) -> str:
    """Return a name that matplotlib draws literally: not a formula, and visible in a legend.

    A user's own agent is shortened to the last part of its path.
    """
    text = printable(short_name(name)).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def looks(agents: Iterable[str]) -> dict[str, Look]:
    """Return a look for each agent; a user's own agent gets an unused one if possible."""
    names = in_order(agents)
    absent = [look for name, look in _KNOWN.items() if name not in names and look.dashes == "-"]
    free = [*_SPARE, *absent]
    spare = chain(free, cycle([replace(look, dashes=_DASHED) for look in free]))
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


def line_options(look: Look) -> dict[str, Any]:
    """Return the options of an agent's line."""
    return {
        "color": look.color,
        "linestyle": look.dashes,
        "marker": look.marker,
        "markersize": 4,
        "markeredgewidth": 0,
        "linewidth": 1.6,
    }


def markers(count: int, agent: int, agents: int) -> tuple[int, int]:
    """Return the positions of a line's markers, staggered so that overlapping lines show theirs."""
    every = max(count // 5, 1)
    return (agent * every // max(agents, 1), every)


def name_agents(figure: Figure, looks: Mapping[str, Look], extra: tuple[Line2D, ...] = ()) -> None:
    """Draw one legend above the whole figure."""
    handles = [Line2D([], [], label=drawn(a), **line_options(look)) for a, look in looks.items()]
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
