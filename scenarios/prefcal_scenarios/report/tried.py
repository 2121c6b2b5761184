"""Figure: every θ tried, as parallel coordinates."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure

from prefcal_env.knobs import Knob
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.report.style import BEST, FAINT, HEAT, INK, canvas
from prefcal_scenarios.report.wording import knob_axis, number


def tried(record: Record) -> Figure:
    """One line a θ across the knobs' axes, coloured by cost (or order), the best in blue."""
    assert record.best is not None
    space = record.scenario.space
    cube = np.array([space.encode(theta) for theta in record.thetas])
    values, label, reverse = _colouring(record)
    norm = PowerNorm(0.5, *_range(values))
    figure = canvas(3.6)
    axes = figure.subplots()
    places = np.arange(len(space))
    for i in np.argsort(values if reverse else -values, kind="stable"):
        stopped = record.trials[i].experiment.end.interrupted
        axes.plot(
            places, cube[i], color=HEAT(norm(values[i])), linewidth=1.1,
            linestyle=":" if stopped else "-",
        )  # fmt: skip
    best = space.encode(record.best.experiment.theta)
    axes.plot(places, best, color="white", linewidth=5.5, zorder=4, solid_capstyle="round")
    axes.plot(places, best, "o-", color=BEST, linewidth=2.8, markersize=7, zorder=5, clip_on=False)
    _axis_lines(axes, list(space), record.best.experiment.theta)
    extend = "max" if values.max() > (norm.vmax or 0) else "neither"
    bar = figure.colorbar(ScalarMappable(norm, HEAT), ax=axes, pad=0.02, aspect=26, extend=extend)
    bar.outline.set_visible(False)
    bar.set_label(label, color=INK)
    axes.set_title(
        f"All {len(cube)} θ tried; best in blue (experiment {record.best.number})", pad=22
    )
    return figure


def _colouring(record: Record) -> tuple[Float[np.ndarray, " N"], str, bool]:
    """Values to colour by, what they are, and whether small ones are drawn first."""
    if record.scenario.cost is None:
        order = np.array([-float(t.number) for t in record.trials])
        return order, "− experiment", False
    costs = np.array([t.cost for t in record.trials], dtype=float)
    return costs, "performance index (low is good)", False


def _range(values: Float[np.ndarray, " N"]) -> tuple[float, float]:
    """Colours end at the better three quarters: whatever is worse is merely bad."""
    finite = values[np.isfinite(values)]
    if not len(finite):  # every cost is infinite
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
        axes.annotate(
            number(value), (i, knob.encode(value)), (9, 0), textcoords="offset points",
            va="center", color=BEST, fontweight="bold", zorder=6,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
        )  # fmt: skip
