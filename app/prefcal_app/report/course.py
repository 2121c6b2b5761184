"""Draw what was tried: KPIs of every experiment and of the best so far, and costs along each knob."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from prefcal_app.view.status import slices_view
from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.presentation.style import BEST, FAINT, GOOD, LIMIT, canvas, legend, look
from prefcal_scenarios.presentation.wording import knob_axis, knob_number, labeled, mathtext
from prefcal_scenarios.scenario import KPI

from .record import StudyRecord
from .tables import foremost_kpis

INDEX = KPI("performance index", "performance index (lower is better)", better="lower")
"""The score that the answers follow, drawn as a KPI."""
_ROWS = 4
"""Maximum number of KPIs to draw."""
_ACROSS = 3
"""Number of knobs next to each other."""
_LEAST = 10
"""Smallest span of an axis in differences that people can just see: fewer must not look large."""
_INNER = (0.05, 0.9)
"""Quantiles of the experiments that are always within the scale."""


def course(record: StudyRecord) -> Figure:
    """Draw each KPI in a row, with a dot per experiment and steps for the best.

    The performance index comes first if the answers follow it.
    """
    kpis = drawn_kpis(record)
    figure = canvas(0.8 + 1.35 * len(kpis))
    grid = figure.subplots(len(kpis), 1, sharex=True, squeeze=False)[:, 0]
    for axes, kpi in zip(grid, kpis, strict=True):
        _kpi(axes, record, kpi)
    grid[-1].set_xlim(0.3, record.trials[-1].number + 0.7)
    grid[-1].xaxis.set_major_locator(MaxNLocator(10, integer=True))
    grid[-1].set_xlabel("experiment")
    legend(figure, grid[0], 4)
    return figure


def drawn_kpis(record: StudyRecord) -> list[KPI]:
    """Return the KPIs that tell experiments apart, as many as fit, largest change first."""
    index = [INDEX] if record.shows_cost else []
    return index + foremost_kpis(record, _ROWS - len(index))


def _values(record: StudyRecord, kpi: KPI) -> Float[np.ndarray, " N"]:
    """Return the KPI of every trial as read, or its cost; NaN if unknown."""
    if kpi is INDEX:
        return np.array([np.nan if t.cost is None else t.cost for t in record.trials])
    return record.read(kpi)


def _held(record: StudyRecord, values: Float[np.ndarray, " N"]) -> Float[np.ndarray, " H"]:
    """Return the value of the best so far after each comparison."""
    by_index = dict(zip((t.index for t in record.trials), values, strict=True))
    return np.array([by_index[t.index] for t in record.incumbents])


def _kpi(axes: Axes, record: StudyRecord, kpi: KPI) -> None:
    numbers = np.array([t.number for t in record.trials])
    answered = np.array([c.query.challenger.index + 1 for c in record.comparisons])
    values = _values(record, kpi)
    low, high = _scale(record, kpi)
    axes.plot(
        answered,
        np.clip(_held(record, values), low, high),
        color=BEST,
        linewidth=2.0,
        drawstyle="steps-post",
        label="best so far",
        zorder=3,
    )
    dots: dict[str, Any] = {"linestyle": "", "markeredgewidth": 0, "clip_on": False}
    inside = (values >= low) & (values <= high)
    dots |= {"color": FAINT, "alpha": 0.6, "markersize": 4.5}
    axes.plot(numbers[inside], values[inside], "o", **dots, label="one experiment")
    dots |= {"color": LIMIT, "alpha": 0.75, "markersize": 5, "label": "off the scale or never"}
    for off, at, marker in ((values > high, high, "^"), (values < low, low, "v")):
        if off.any():
            axes.plot(numbers[off], np.full(off.sum(), at), marker, **dots)
    line: dict[str, Any] = {"color": GOOD, "linewidth": 1.1, "linestyle": (0, (5, 3))}
    limits = [limit for limit in (kpi.at_least, kpi.at_most) if low <= limit <= high]
    for i, limit in enumerate(limits):
        axes.axhline(limit, **line, label="objective" if not i else None)
    for i, (name, cost) in enumerate(record.reference_costs.items() if kpi is INDEX else ()):
        color, dashes = look(i)
        axes.axhline(cost, color=color, linewidth=1.2, linestyle=dashes, label=name)
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.set_title(labeled(mathtext(kpi.title), kpi.unit))


def _scale(record: StudyRecord, kpi: KPI) -> tuple[float, float]:
    """Return axis limits that include most experiments and every best one, but no outliers.

    Costs of the first experiments can be a hundred times the best one: the index has the scale of
    the references and of the best after half of the initial samples.
    """
    values = _values(record, kpi)
    finite, held = values[np.isfinite(values)], _held(record, values)
    if not len(finite):
        return 0.0, 1.0
    if kpi is INDEX:
        settled = held[min(record.n_init // 2, len(held) - 1) :]
        shown = [*settled, *record.reference_costs.values()]
        shown = [value for value in shown if np.isfinite(value)] or finite.tolist()
    else:
        shown = [*held[np.isfinite(held)].tolist(), *np.quantile(finite, _INNER).tolist()]
    low, high = _widened(min(shown), max(shown), kpi)
    near = [v for v in (kpi.at_least, kpi.at_most) if low - (high - low) < v < high + (high - low)]
    low, high = min(low, *near, high), max(high, *near, low)
    margin = 0.08 * (high - low)
    bottom = low - margin
    return (max(bottom, 0.0) if low >= 0 and bottom < 0 else bottom), high + margin


def _widened(low: float, high: float, kpi: KPI) -> tuple[float, float]:
    """Return a span of `_LEAST` visible differences or more; one of positive values stays so."""
    digits = 10.0 ** min(np.floor(np.log10(max(abs(low), abs(high)) or 1.0)) - 3, 0)  # of four
    lacking = max(_LEAST * max(kpi.step, digits) - (high - low), 0.0)
    down = lacking / 2 if low < 0 else min(lacking / 2, low)
    return low - down, high + lacking - down


def knobs(record: StudyRecord) -> Figure:
    """Draw each experiment along each knob, at its learned cost or else at its number."""
    assert record.best is not None
    space, best = record.scenario.space, record.best
    across = min(len(space), _ACROSS)
    down = -(-len(space) // across)
    figure = canvas(0.4 + 2.5 * down)
    grid = figure.subplots(down, across, squeeze=False)
    for axes in grid.flat[len(space) :]:
        axes.set_visible(False)
    learned = record.surrogate and slices_view(space, best.experiment.theta, record.thetas, record.surrogate)
    numbers = [trial.number for trial in record.trials]
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "clip_on": False}
    for k, (axes, knob) in enumerate(zip(grid.flat, space, strict=False)):
        if learned:
            x, y = learned[k]["x"], learned[k]["y"]
            axes.plot(x, y, color=BEST, linewidth=2)
            tried, height = learned[k]["samples"]["y"], np.interp(learned[k]["best"], x, y)
        else:
            tried, height = numbers, best.number
            axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.plot(record.thetas[:, k], tried, **dot, color=FAINT, alpha=0.5, ms=4, mew=0)
        theta = best.experiment.theta[k]
        axes.plot(theta, height, **dot, color=BEST, ms=8, mec="white", mew=1.2, zorder=5)
        axes.set_title(f"best {knob_number(knob, theta)}", color=BEST, fontweight="bold")
        _along(axes, knob)
    words = "learned cost, square root\n(0: the lowest shown)" if learned else "experiment"
    for axes in grid[:, 0]:
        axes.set_ylabel(words)
    return figure


def _along(axes: Axes, knob: Knob) -> None:
    """Show the whole range of a knob."""
    axes.set_xlabel(knob_axis(knob))
    if knob.scale == "log10":
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=knob.integer))
    axes.set_xlim(knob.low, knob.high)
