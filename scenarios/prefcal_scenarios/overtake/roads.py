"""The road seen from above, to scale, with the vehicles at a moment of the overtaking."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from prefcal_env.envs.overtake.geometry import corners
from prefcal_env.experiment import Experiment
from prefcal_env.overtaking import LENGTH
from prefcal_scenarios.overtake.moments import Moment, moments
from prefcal_scenarios.overtake.scene import bodies, lines_of, road_of
from prefcal_scenarios.overtake.shown import ASPHALT, DASH, OBSTACLE, PAINT, PERIOD, Shown, windows
from prefcal_scenarios.report.style import FAINT

_CAPTION = 3.4
"""Height of a caption [m]."""


def breadth(experiment: Experiment) -> float:
    """Of a road with its caption [m]."""
    low, high = road_of(experiment)
    return high - low + _CAPTION


def road(
    axes: Axes, start: float, end: float, edges: tuple[float, float], offset: float = 0.0
) -> None:
    """All lanes, the edges [m] of the road, and the broken lines between lanes."""
    low, high = (side + offset for side in edges)
    axes.fill_between([start, end], low, high, color=ASPHALT, linewidth=0, zorder=0)
    for side in (low, high):
        axes.plot([start, end], [side, side], color=PAINT, linewidth=1.2, zorder=0.5)
    dashes = np.arange(np.floor(start / PERIOD) * PERIOD, end, PERIOD)
    for line in lines_of(edges):
        axes.hlines(
            np.full(len(dashes), offset + line), np.maximum(dashes, start),
            np.minimum(dashes + DASH, end), color=PAINT, linewidth=1.2, zorder=0.5,
        )  # fmt: skip


def stacked(axes: Axes, shown: Shown, window: float) -> None:
    """One road for each moment, to scale, in the order of time from above."""
    (low, high), each = road_of(shown.experiment), breadth(shown.experiment)
    for row, moment in enumerate(moments(shown.experiment)):
        offset = -each * row
        strip(axes, shown, moment, window, offset)
        top = offset + high + 0.7
        caption(axes, -window / 2, top, row + 1, shown.experiment, moment)
    axes.set_aspect("equal", anchor="W")
    axes.set_ylim(-4 * each + low - 0.3, high + _CAPTION)
    bare(axes)


def strip(axes: Axes, shown: Shown, moment: Moment, window: float, offset: float) -> None:
    """Both bodies at a moment, on the road around them; x counts from the middle of them."""
    experiment, k = shown.experiment, moment.index
    others = bodies(experiment)
    own = experiment.x[:, :3]
    x = float(own[k, 0])
    nearest = min(others[:, k, 0].tolist(), key=lambda x_o: abs(x_o - x), default=x)
    middle = (x + nearest - LENGTH) / 2
    road(axes, -window / 2, window / 2, road_of(experiment), offset)
    seen = np.abs(own[:, 0] - middle) <= window / 2
    axes.plot(
        own[seen, 0] - middle, own[seen, 1] + offset, color=shown.color, linewidth=1.0, alpha=0.55
    )
    shift = np.array([-middle, offset])
    for other in others:
        _body(axes, other[k], shift, OBSTACLE)
    _body(axes, own[k], shift, shown.color)
    axes.set_xlim(-window / 2, window / 2)


def _body(axes: Axes, pose: Float[np.ndarray, " 3"], shift: Any, color: str) -> None:
    """Outline of 4.5 x 1.8 m with its windscreen, clipped to the axes."""
    outline = corners(pose[None])[0] + shift
    axes.add_collection(
        PolyCollection([outline], facecolor=color, edgecolor="white", linewidth=0.6, zorder=3)
    )
    axes.add_collection(
        PolyCollection(windows(outline), facecolor="white", alpha=0.8, linewidth=0, zorder=4)
    )


def caption(axes: Axes, x: float, y: float, n: int, run: Experiment, moment: Moment) -> None:
    """Number, name, time and place of a moment, from (x, y) on; on two lines around x = 0."""
    where = f"{run.t[moment.index]:.1f} s · {run.x[moment.index, 0]:.0f} m"
    centred = x == 0
    named = moment.name + ("\n" if centred else " · ") if moment.name else ""
    axes.annotate(
        f"{n}  {named}{where}", (x, y), fontsize=7.6, color=FAINT, linespacing=1.3,
        ha="center" if centred else "left", annotation_clip=False,
    ).set_in_layout(False)  # fmt: skip


def bare(axes: Axes) -> None:
    """Take ticks, grid and frame away."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set_visible(False)
