"""Draw the road seen from above with matplotlib, to scale."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PolyCollection
from matplotlib.colors import to_rgba

from prefcal_env.envs.overtake.road.rules import LENGTH
from prefcal_scenarios.app.presentation.style import FAINT

from .drawing import Drawing, Frame, Polygon
from .moments import Moment, moments
from .shown import OBSTACLE, Shown

_CAPTION = 3.4
"""Height of a caption [m]."""
PAINT = "#aab3bc"
_COLORS: Mapping[str, str] = {
    "asphalt": "#eceff2", "paint": PAINT, "other": OBSTACLE, "glass": "#ffffff",
}  # fmt: skip
"""Colors by role; every other role has the color of the run."""
_WIDTHS: Mapping[str, float] = {"paint": 1.2, "path": 1.0, "trace": 1.2}
_ALPHAS: Mapping[str, float] = {"path": 0.45, "glass": 0.8}


def breadth(drawing: Drawing) -> float:
    """Return the width of a road with its caption [m]."""
    low, high = drawing.road
    return high - low + _CAPTION


def paint(
    axes: Axes, frame: Frame, color: str, shift: tuple[float, float] = (0.0, 0.0)
) -> list[Collection]:
    """Draw a frame, moved by `shift` [m], and return its artists; `color` is that of the run."""
    ground = [p for p in frame.polygons if p.role == "asphalt"]
    vehicles = [p for p in frame.polygons if p.role != "asphalt"]
    lines = LineCollection(
        [line.points + np.array(shift) for line in frame.lines],
        colors=[_color(line.role, color) for line in frame.lines],
        linewidths=[_WIDTHS[line.role] for line in frame.lines],
        zorder=1,
    )
    made = [_filled(ground, color, shift, 0), lines, _filled(vehicles, color, shift, 3)]
    for collection in made:
        axes.add_collection(collection, autolim=False)  # the callers set the limits
    return made


def _filled(
    polygons: Sequence[Polygon], color: str, shift: tuple[float, float], order: int
) -> PolyCollection:
    """Return the polygons in one collection; cars have a white rim."""
    return PolyCollection(
        [p.points + np.array(shift) for p in polygons],
        facecolors=[_color(p.role, color) for p in polygons],
        edgecolors="white",
        linewidths=[0.6 if p.role in ("own", "other") else 0.0 for p in polygons],
        zorder=order,
    )


def _color(role: str, color: str) -> tuple[float, float, float, float]:
    return to_rgba(_COLORS.get(role, color), _ALPHAS.get(role))


def stacked(axes: Axes, shown: Shown, window: float) -> None:
    """Draw one road for each moment, to scale, in the order of time from above."""
    drawing = Drawing.of(shown.experiment)
    (low, high), each = drawing.road, breadth(drawing)
    for row, moment in enumerate(moments(shown.experiment)):
        offset = -each * row
        strip(axes, shown, moment, window, offset)
        caption(axes, (-window / 2, offset + high + 0.7), row + 1, shown, moment)
    axes.set_aspect("equal", anchor="W")
    axes.set_ylim(-4 * each + low - 0.3, high + _CAPTION)
    bare(axes)


def strip(axes: Axes, shown: Shown, moment: Moment, window: float, offset: float) -> None:
    """Draw the cars at a moment on the road around them; x counts from the middle of them."""
    drawing, time = Drawing.of(shown.experiment), float(shown.experiment.t[moment.index])
    now = drawing.at(time)
    x = float(now.own[0])
    nearest = min(now.others[:, 0].tolist(), key=lambda x_o: abs(x_o - x), default=x)
    middle = (x + nearest - LENGTH) / 2
    frame = drawing.frame(time, middle - window / 2, middle + window / 2)
    paint(axes, frame, shown.color, (-middle, offset))
    axes.set_xlim(-window / 2, window / 2)


def caption(axes: Axes, at: tuple[float, float], n: int, shown: Shown, moment: Moment) -> None:
    """Write number, name, time and place of a moment, from `at` on; around x = 0 on two lines."""
    run, (x, y) = shown.experiment, at
    where = f"{run.t[moment.index]:.1f} s · {run.x[moment.index, 0]:.0f} m"
    centered = x == 0
    named = moment.name + ("\n" if centered else " · ") if moment.name else ""
    axes.annotate(
        f"{n}  {named}{where}", (x, y), fontsize=7.6, color=FAINT, linespacing=1.3,
        ha="center" if centered else "left", annotation_clip=False,
    ).set_in_layout(False)  # fmt: skip


def bare(axes: Axes) -> None:
    """Remove ticks, grid and frame."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set_visible(False)
