"""Draw the index of every experiment, and the best so far."""

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_scenarios.presentation.style import BEST, FAINT, LIMIT, canvas, legend, look
from prefcal_scenarios.presentation.wording import number

from .record import Record


def best_so_far(record: Record) -> Figure:
    """Draw the cost of experiments as dots, the best so far as steps, and references as lines."""
    numbers = np.array([t.number for t in record.trials])
    costs = np.array([np.nan if t.cost is None else t.cost for t in record.trials])
    answered = np.array([c.query.challenger.index + 1 for c in record.comparisons])
    held = np.array([np.nan if t.cost is None else t.cost for t in record.incumbents])
    figure = canvas(3.3)
    axes = figure.subplots()
    top = _ceiling(record, held)
    shaded = min(record.n_init, record.n_max)
    axes.plot(
        answered, np.minimum(held, top), color=BEST, linewidth=2.2, drawstyle="steps-post",
        label=f"best so far: {number(held[-1])}", zorder=3,
    )  # fmt: skip
    axes.plot(answered[-1], min(held[-1], top), "o", color=BEST, markersize=6, zorder=3)
    for i, (name, cost) in enumerate(record.reference_costs.items()):
        color, dashes = look(i)
        axes.axhline(
            cost, color=color, linewidth=1.2, linestyle=dashes, label=f"{name}: {number(cost)}"
        )
    _dots(axes, numbers, costs, top)
    axes.axvspan(0.3, shaded + 0.5, color="#e9edf1", linewidth=0, zorder=0, label="initial samples")
    axes.set_xlim(0.3, record.n_max + 0.7)
    axes.set_xlabel("experiment")
    axes.set_title("Performance index of each experiment (lower is better)")
    legend(figure, axes, 3)
    return figure


def _dots(
    axes: Axes, numbers: Int[np.ndarray, " N"], costs: Float[np.ndarray, " N"], top: float
) -> None:
    inside = costs <= top
    axes.plot(
        numbers[inside], costs[inside], "o", color=FAINT, alpha=0.55, markersize=4.5,
        markeredgewidth=0, label="one experiment",
    )  # fmt: skip
    if not inside.all():
        axes.plot(
            numbers[~inside], np.full((~inside).sum(), top), "^", color=LIMIT, alpha=0.75,
            markersize=5, markeredgewidth=0, clip_on=False, label="off the scale or unsafe",
        )  # fmt: skip
    low = min(np.nanmin(costs, initial=np.inf), top - 1e-9)
    axes.set_ylim(low - 0.06 * (top - low), top)


def _ceiling(record: Record, held: Float[np.ndarray, " N"]) -> float:
    """Return the upper end of the axis, based on the second half of the initial samples.

    Costs of earlier and other experiments can be a hundred times the best one and would flatten
    the plot.
    """
    settled = held[min(record.n_init // 2, len(held) - 1) :]
    shown = np.array([*record.reference_costs.values(), *settled])
    shown = shown[np.isfinite(shown)]
    if not len(shown):  # if every cost is infinite
        return 1.0
    low, high = shown.min(), shown.max()
    return float(high + 0.08 * (high - low if high > low else 1.0))
