"""Draw the KPIs of every experiment and of the best so far, and the answers."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from prefcal_app.summary.counts import VERDICTS
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.presentation.style import BEST, FAINT, GOOD, LIMIT, canvas, legend, look
from prefcal_scenarios.presentation.wording import labeled, mathtext
from prefcal_scenarios.scenario import KPI

from .record import Record
from .tables import foremost_kpis

INDEX = KPI("performance index", "performance index (lower is better)", better="lower")
"""The score that the answers follow, drawn as a KPI."""
_ROWS = 4
"""Maximum number of KPIs to draw."""
_LEAST = 10
"""Smallest span of an axis in differences that people can just see: fewer must not look large."""
_BESIDE = 0.018
"""Distance of the answers on one experiment, as a share of the axis: squares do not touch."""
_INNER = (0.05, 0.9)
"""Quantiles of the experiments that are always within the scale."""


def course(record: Record) -> Figure:
    """Draw each KPI in a row, with a dot per experiment and steps for the best; answers below.

    The performance index comes first if the answers follow it.
    """
    kpis = drawn_kpis(record)
    heights = [1.35] * len(kpis) + [1.05] * bool(record.asked)
    figure = canvas(0.8 + sum(heights))
    grid = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    for axes, kpi in zip(grid[: len(kpis), 0], kpis, strict=True):
        _kpi(axes, record, kpi)
    last = grid[-1, 0]
    if record.asked:
        _verdicts(last, record)
    last.set_xlim(0.3, max(t.number for t in record.trials) + 0.7)
    last.xaxis.set_major_locator(MaxNLocator(10, integer=True))
    last.set_xlabel("experiment")
    if kpis:
        legend(figure, grid[0, 0], 4)
    return figure


def drawn_kpis(record: Record) -> list[KPI]:
    """Return the KPIs that tell experiments apart, as many as fit, largest change first."""
    index = [INDEX] if record.shows_cost else []
    return index + foremost_kpis(record, _ROWS - len(index))


def draws_objectives(record: Record) -> bool:
    """Return whether the figure shows an objective: those off the scale of their KPI are not."""
    return any(_limits_within(kpi, *_scale(record, kpi)) for kpi in drawn_kpis(record))


def _limits_within(kpi: KPI, low: float, high: float) -> list[float]:
    return [limit for limit in (kpi.at_least, kpi.at_most) if low <= limit <= high]


def _values(record: Record, kpi: KPI) -> Float[np.ndarray, " N"]:
    """Return the KPI of every trial as read, or its cost; NaN if unknown."""
    if kpi is INDEX:
        return np.array([np.nan if t.cost is None else t.cost for t in record.trials])
    return record.read(kpi)


def _held(record: Record, values: Float[np.ndarray, " N"]) -> Float[np.ndarray, " H"]:
    """Return the value of the best so far after each comparison."""
    by_index = dict(zip((t.index for t in record.trials), values, strict=True))
    return np.array([by_index[t.index] for t in record.incumbents])


def _kpi(axes: Axes, record: Record, kpi: KPI) -> None:
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
    dot = {"marker": "o", "color": FAINT, "alpha": 0.6, "markersize": 4.5}
    axes.plot(numbers[inside], values[inside], **dots, **dot, label="one experiment")
    for off, at, marker in ((values > high, high, "^"), (values < low, low, "v")):
        if off.any():
            sign = {"marker": marker, "color": LIMIT, "alpha": 0.75, "markersize": 5}
            words = "off the scale or never"
            axes.plot(numbers[off], np.full(off.sum(), at), **dots, **sign, label=words)
    line: dict[str, Any] = {"color": GOOD, "linewidth": 1.1, "linestyle": (0, (5, 3))}
    for i, limit in enumerate(_limits_within(kpi, low, high)):
        axes.axhline(limit, **line, label="objective" if not i else None)
    for i, (name, cost) in enumerate(record.reference_costs.items() if kpi is INDEX else ()):
        color, dashes = look(i)
        axes.axhline(cost, color=color, linewidth=1.2, linestyle=dashes, label=name)
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.set_title(labeled(mathtext(kpi.title), kpi.unit))


def _scale(record: Record, kpi: KPI) -> tuple[float, float]:
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


def _verdicts(axes: Axes, record: Record) -> None:
    """Draw a mark for each answer, in the row of its verdict."""
    rows = {verdict: -k for k, verdict in enumerate(VERDICTS)}
    count = max(t.number for t in record.trials)
    for verdict, row in rows.items():
        color = BEST if verdict is Preference.CHALLENGER else FAINT
        given = [c.query for c in record.asked if c.answer.preference is verdict]
        places = _beside([q.challenger.index + 1 for q in given], _BESIDE * count)
        at = [x for x, q in zip(places, given, strict=True) if not q.further]
        axes.plot(at, [row] * len(at), "s", color=color, markersize=4.5, markeredgewidth=0)
        if at := [x for x, q in zip(places, given, strict=True) if q.further]:
            axes.plot(at, [row] * len(at), "s", color=color, markersize=8, markerfacecolor="none")
    axes.set_yticks(list(rows.values()), list(VERDICTS.values()))
    axes.set_ylim(-len(rows) + 0.4, 0.6)
    axes.set_title("Answers")


def _beside(numbers: Sequence[int], distance: float) -> list[float]:
    """Return a place for each answer: beside each other if they are on the same experiment."""
    total, so_far = Counter(numbers), Counter[int]()
    places = []
    for n in numbers:
        apart = min(distance, 0.9 / total[n])
        places.append(n + (so_far[n] - (total[n] - 1) / 2) * apart)
        so_far[n] += 1
    return places
