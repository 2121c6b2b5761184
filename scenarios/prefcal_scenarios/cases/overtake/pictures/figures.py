"""Figures of an overtaking: path, bodies, speed and steering along the road, section IV-B."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_env.envs.overtake.road.rules import KEEPING_SPEEDS, LENGTH, OVERTAKING_SPEEDS
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.app.presentation.style import FAINT, GOOD, LIMIT, WIDTH, canvas
from prefcal_scenarios.app.presentation.wording import mathtext, number
from prefcal_scenarios.app.report.record import Record
from prefcal_scenarios.cases.overtake.scene import obstacles, phases, road_of

from .drawing import Drawing
from .moments import moments
from .roads import bare, breadth, caption, paint, stacked, strip
from .shown import OBSTACLE, Shown, best, first

STEERING_LIMIT = 45.0
"""Limit of |δ_s| [°]."""
_DASHED: Any = (0, (6, 3))


def comparison(record: Record) -> Figure:
    """Draw the best run to the left and the first to the right, as in Fig. car_comparison."""
    return compared(best(record), first(record), record.scenario.space)


def final(record: Record) -> Figure:
    """Draw the best run alone, wide, as in Fig. car_finalPerf."""
    return wide(best(record), record.scenario.space)


def compared(left: Shown, right: Shown, space: KnobSpace) -> Figure:
    """Draw two runs side by side along the road, as in Fig. car_comparison."""
    pair = (left, right)
    window = 56.0
    # Height in inches of a road that is to scale.
    each = (WIDTH - 0.7) / 2 / window * breadth(Drawing.of(left.experiment))
    heights = [1.35, 5 * each, 1.5, 1.5]
    figure = canvas(2.7 + sum(heights))
    axes = figure.subplots(4, 2, sharey="row", height_ratios=heights)
    for column, shown in enumerate(pair):
        _along(axes[[0, 2, 3], column], shown, pair)
        stacked(axes[1, column], shown, window)
        _above(axes[0, column], theta_lines(space, shown), 20, color=FAINT, fontsize=8.2)
        _above(axes[0, column], _computing(shown.experiment), 47, fontsize=8.8)
        _above(axes[0, column], shown.label, 62, color=shown.color, fontweight="bold")
    for axis in axes[:, 1]:
        axis.set_ylabel("")
    figure.align_ylabels(axes[:, 0])
    return figure


def wide(shown: Shown, space: KnobSpace) -> Figure:
    """Draw one run along the road, as in Fig. car_finalPerf."""
    figure = canvas(7.4)
    grid = figure.add_gridspec(4, 5, height_ratios=[1.5, 1.0, 1.6, 1.6])
    along = np.array([figure.add_subplot(grid[row, :]) for row in (0, 2, 3)])
    _along(along, shown, (shown,))
    for column, moment in enumerate(moments(shown.experiment)):
        place = figure.add_subplot(grid[1, column])
        strip(place, shown, moment, 33.0, 0.0)
        place.set_aspect("equal")
        low, high = road_of(shown.experiment)
        caption(place, (0.0, high + 0.8), column + 1, shown, moment)
        place.set_ylim(low - 0.4, high + 6.2)
        bare(place)
    figure.align_ylabels(along)
    theta = theta_lines(space, shown).replace("\n", ",  ")
    _above(along[0], theta, 20, color=FAINT, fontsize=8.5)
    title = f"{shown.label}: {_computing(shown.experiment)}"
    _above(along[0], title, 35, color=shown.color, fontweight="bold")
    return figure


def theta_lines(space: KnobSpace, shown: Shown) -> str:
    """Return θ in mathtext, on two lines."""
    parts = [
        f"{mathtext(k.name)} = {number(v)}" + (f" {k.unit}" if k.unit else "")
        for k, v in zip(space, shown.experiment.theta, strict=True)
    ]
    return ",  ".join(parts[:3]) + "\n" + ",  ".join(parts[3:])


def _computing(experiment: Experiment) -> str:
    """Return the worst modeled t_comp compared with T_s, as text."""
    worst, T_s = experiment.kpis["t_comp_worst"], experiment.theta[0]
    sign = "≤" if worst <= T_s else ">"
    return f"worst $t_{{comp}}$ {1e3 * worst:.0f} ms {sign} $T_s$ {1e3 * T_s:.0f} ms"


def _above(axes: Axes, text: str, points: float, **look: Any) -> None:
    axes.annotate(
        text, (0, 1), (0, points), xycoords="axes fraction", textcoords="offset points", **look
    )


def _along(axes: Sequence[Axes] | np.ndarray, shown: Shown, pair: Sequence[Shown]) -> None:
    """Draw path, speed and steering angle over the longitudinal position."""
    path, speed, steering = axes
    _path(path, shown, pair)
    _speed(speed, shown)
    _steering(steering, shown)
    last = max(float(s.experiment.x[:, 0].max()) for s in pair)
    for axis in (path, speed, steering):
        axis.set_xlim(-LENGTH, last + 5)
    for axis in (path, steering):
        axis.set_xlabel("longitudinal position [m]")


def _path(axes: Axes, shown: Shown, pair: Sequence[Shown]) -> None:
    experiment = shown.experiment
    x, y = experiment.x[:, 0], experiment.x[:, 1]
    end = max(float(s.experiment.x[:, 0].max()) for s in pair) + 10
    paint(axes, Drawing.of(experiment).ground(-2 * LENGTH, end), shown.color)
    others = obstacles(experiment)
    for other in others:
        axes.plot(*other.T, color=OBSTACLE, linewidth=1.5, linestyle=(0, (4, 1.5)))
    axes.plot(x, y, color=shown.color, linewidth=2)
    for n, moment in enumerate(moments(experiment), start=1):
        for other in others:
            _numbered(axes, other[moment.index], n, OBSTACLE)
        _numbered(axes, experiment.x[moment.index, :2], n, shown.color)
    low, high = road_of(experiment)
    reach = [float(f(s.experiment.x[:, 1])) for s in pair for f in (np.min, np.max)]
    axes.set_ylim(min(low - 0.5, *reach), max(high + 0.5, *reach))
    axes.set_yticks([0, 3, 6])
    axes.set_ylabel("lateral position [m]")
    axes.grid(visible=False)
    axes.set_title("Path of the car and of the obstacle (orange)")


def _numbered(axes: Axes, at: Float[np.ndarray, " 2"], n: int, color: str) -> None:
    x, y = at.tolist()
    axes.plot(x, y, "o", color=color, markersize=9, markeredgecolor="white", markeredgewidth=0.8)
    axes.annotate(
        str(n), (x, y), color="white", fontsize=6.5, fontweight="bold", ha="center",
        va="center_baseline",
    )  # fmt: skip


def _speed(axes: Axes, shown: Shown) -> None:
    experiment = shown.experiment
    x = experiment.x[:, 0]
    signals = experiment.signals
    limits = np.array([KEEPING_SPEEDS, OVERTAKING_SPEEDS])[phases(experiment)] / KMH
    held: Any = {"drawstyle": "steps-post"}
    for limit in limits.T:
        axes.plot(x, limit, color=LIMIT, linewidth=1.1, linestyle=_DASHED, **held)
    axes.plot(
        x, signals["speed_reference"] / KMH, color=GOOD, linewidth=1.2, linestyle=(0, (1, 1.5)),
        **held,
    )  # fmt: skip
    axes.plot(x, experiment.u[:, 0] / KMH, color=shown.color, **held)
    axes.set_ylim(36, 74)
    axes.set_ylabel("speed [km/h]")
    axes.set_title("Speed $v$, its reference (dotted) and limits (dashed)")


def _steering(axes: Axes, shown: Shown) -> None:
    experiment = shown.experiment
    for limit in (-STEERING_LIMIT, STEERING_LIMIT):
        axes.axhline(limit, color=LIMIT, linewidth=1.1, linestyle=_DASHED)
    x, steering = experiment.x[:, 0], np.degrees(experiment.u[:, 1])
    axes.plot(x, steering, color=shown.color, drawstyle="steps-post")
    axes.set_ylim(-52, 52)
    axes.set_yticks([-45, 0, 45])
    axes.set_ylabel("steering angle [°]")
    axes.set_title(r"Steering angle $\delta_s$ and its limits (dashed)")
