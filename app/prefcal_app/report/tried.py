"""Draw every θ tried, as parallel coordinates."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.presentation.style import BEST, FAINT, HEAT, INK, canvas
from prefcal_scenarios.presentation.wording import knob_axis, knob_number, number

from .record import Record


@dataclass(frozen=True, slots=True)
class _Colors:
    """Values that color the lines, and the order in which lines are drawn."""

    values: Float[np.ndarray, " N"]
    label: str
    map: Colormap
    norm: Normalize
    order: Int[np.ndarray, " N"]
    extend: Literal["max", "neither"] = "neither"


def tried(record: Record) -> Figure:
    """Draw each θ as a line across the knobs' axes, colored by cost or order; the best is blue."""
    assert record.best is not None
    space = record.scenario.space
    cube = np.array([space.encode(theta) for theta in record.thetas])
    colors = _by_cost(record) if record.shows_cost else _by_number(record)
    figure = canvas(3.8)
    axes = figure.subplots()
    places = np.arange(len(space))
    for i in colors.order:
        stopped = record.trials[i].experiment.end.interrupted
        axes.plot(
            places, cube[i], color=colors.map(colors.norm(colors.values[i])), linewidth=1.1,
            linestyle=":" if stopped else "-",
        )  # fmt: skip
    best = space.encode(record.best.experiment.theta)
    axes.plot(places, best, color="white", linewidth=5.5, zorder=4, solid_capstyle="round")
    axes.plot(places, best, "o-", color=BEST, linewidth=2.8, markersize=7, zorder=5, clip_on=False)
    _axis_lines(axes, list(space), record.best.experiment.theta)
    bar = figure.colorbar(
        ScalarMappable(colors.norm, colors.map), ax=axes, pad=0.02, aspect=26, extend=colors.extend
    )
    bar.outline.set_visible(False)
    bar.set_label(colors.label, color=INK)
    if not record.shows_cost:
        bar.ax.yaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.set_title(
        f"All {len(cube)} θ tried; best in blue (experiment {record.best.number})", pad=22
    )
    return figure


def _by_number(record: Record) -> _Colors:
    """Return colors by number: later θ are darker and drawn over earlier ones."""
    numbers = np.array([float(t.number) for t in record.trials])
    norm = Normalize(1, max(float(numbers.max()), 2.0))
    order = np.argsort(numbers, kind="stable")
    return _Colors(numbers, "number of the experiment", HEAT.reversed(), norm, order)


def _by_cost(record: Record) -> _Colors:
    """Return colors by cost: better θ are darker and drawn over worse ones."""
    costs = np.array([t.cost for t in record.trials], dtype=float)
    norm = PowerNorm(0.5, *_range(costs))
    extend: Literal["max", "neither"] = "max" if costs.max() > (norm.vmax or 0) else "neither"
    order = np.argsort(-costs, kind="stable")
    return _Colors(costs, "performance index (lower is better)", HEAT, norm, order, extend)


def _range(values: Float[np.ndarray, " N"]) -> tuple[float, float]:
    """Return the range of colors, which covers the better three quarters of the values."""
    finite = values[np.isfinite(values)]
    if not len(finite):  # if every cost is infinite
        return 0.0, 1.0
    low, high = np.quantile(finite, [0, 0.75])
    return float(low), float(high if high > low else low + 1)


def _axis_lines(axes: Axes, knobs: list[Knob], best: Float[np.ndarray, " n"]) -> None:
    axes.grid(False)
    for name in ("left", "bottom"):
        axes.spines[name].set_visible(False)
    axes.set_yticks([])
    axes.set_xticks(range(len(knobs)), [knob_axis(k) for k in knobs], color=INK, fontsize=10)
    axes.tick_params(axis="x", pad=14)
    axes.set_xlim(-0.12, len(knobs) - 1 + 0.25)
    axes.set_ylim(-0.02, 1.02)
    for i, (knob, value) in enumerate(zip(knobs, best, strict=True)):
        axes.axvline(i, color="#c5ccd3", linewidth=1.2, zorder=0)
        for end, z, anchor in ((knob.low, 0, "top"), (knob.high, 1, "bottom")):
            axes.annotate(
                number(end), (i, z), (0, -5 if z == 0 else 5), textcoords="offset points",
                ha="center", va=anchor, color=FAINT, fontsize=8.5, annotation_clip=False,
            )  # fmt: skip
        # Below the name: at the point, it would cover lines and the axis' ends.
        axes.annotate(
            f"best {knob_number(knob, value)}", (i, 0), (0, -36), textcoords="offset points",
            ha="center", va="top", color=BEST, fontweight="bold", annotation_clip=False,
        )  # fmt: skip
