"""Draw overtakings: path, speed and steering along the road, and five moments from above."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_env.envs.overtake.road.geometry import corners
from prefcal_env.envs.overtake.road.rules import (
    KEEPING_SPEEDS,
    LANE_WIDTH,
    LENGTH,
    OVERTAKING_SPEEDS,
)
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.app.presentation.style import (
    BEST,
    FAINT,
    FIRST,
    GOOD,
    LIMIT,
    OTHERS,
    WIDTH,
    canvas,
)
from prefcal_scenarios.app.presentation.wording import mathtext, number, theta_text
from prefcal_scenarios.app.report.record import Record
from prefcal_scenarios.scenario import Picture

from .moments import Moment, moments
from .scene import bodies, obstacles, phases, road_of

OBSTACLE, ASPHALT, PAINT = OTHERS[0], "#eceff2", "#aab3bc"
STEERING_LIMIT = 45.0
"""Limit of |δ_s| [°]."""
_DASHED: Any = (0, (6, 3))
_CAPTION = 3.4
"""Height of a caption above a road [m]."""
_SEEN = 112.0
"""Length of road seen from above, of all runs together [m]."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A run to draw, its label and its color."""

    experiment: Experiment
    label: str
    color: str


def shown(record: Record) -> tuple[Shown, ...]:
    """Return the best run and the one before; one run if they are the same."""
    assert record.best is not None
    best, before = record.best, record.before
    runs = (Shown(best.experiment, f"best (experiment {best.number})", BEST),)
    if best.index == before.index:
        return runs
    label = f"{record.baseline.name} ({before.number})"
    return *runs, Shown(before.experiment, label, FIRST)


def drawn(runs: Sequence[Shown], space: KnobSpace) -> Figure:
    """Draw one run or two side by side, as in Fig. car_comparison and Fig. car_finalPerf."""
    window = _SEEN / len(runs)
    low, high = road_of(runs[0].experiment)
    # Height in inches of a road that is to scale.
    each = (WIDTH - 0.7) / _SEEN * (high - low + _CAPTION)
    heights = [1.35, 5 * each, 1.5, 1.5]
    figure = canvas(2.7 + sum(heights))
    axes = figure.subplots(4, len(runs), sharey="row", height_ratios=heights, squeeze=False)
    for column, run in enumerate(runs):
        _along(axes[[0, 2, 3], column], run, runs)
        _stacked(axes[1, column], run, window)
        _above(axes[0, column], _theta_lines(space, run), 20, color=FAINT, fontsize=8.2)
        _above(axes[0, column], _computing(run.experiment), 47, fontsize=8.8)
        _above(axes[0, column], run.label, 62, color=run.color, fontweight="bold")
    for axis in axes[:, 1:].flat:
        axis.set_ylabel("")
    figure.align_ylabels(axes[:, 0])
    return figure


def _theta_lines(space: KnobSpace, run: Shown) -> str:
    """Return θ in mathtext, on two lines."""
    parts = [
        f"{mathtext(k.name)} = {number(v)}" + (f" {k.unit}" if k.unit else "")
        for k, v in zip(space, run.experiment.theta, strict=True)
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


def _along(axes: np.ndarray, run: Shown, runs: Sequence[Shown]) -> None:
    """Draw path, speed and steering angle over the longitudinal position."""
    path, speed, steering = axes
    _path(path, run, runs)
    _speed(speed, run)
    _steering(steering, run)
    last = max(float(r.experiment.x[:, 0].max()) for r in runs)
    for axis in axes:
        axis.set_xlim(-LENGTH, last + 5)
    for axis in (path, steering):
        axis.set_xlabel("longitudinal position [m]")


def _path(axes: Axes, run: Shown, runs: Sequence[Shown]) -> None:
    experiment = run.experiment
    end = max(float(r.experiment.x[:, 0].max()) for r in runs) + 10
    _road(axes, road_of(experiment), (-2 * LENGTH, end))
    for other in obstacles(experiment):
        axes.plot(*other.T, color=OBSTACLE, linewidth=1.5, linestyle=(0, (4, 1.5)))
    axes.plot(*experiment.x[:, :2].T, color=run.color, linewidth=2)
    for n, moment in enumerate(moments(experiment), start=1):
        for other in obstacles(experiment):
            _numbered(axes, other[moment.index], n, OBSTACLE)
        _numbered(axes, experiment.x[moment.index, :2], n, run.color)
    low, high = road_of(experiment)
    reach = [float(f(r.experiment.x[:, 1])) for r in runs for f in (np.min, np.max)]
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


def _speed(axes: Axes, run: Shown) -> None:
    experiment = run.experiment
    x = experiment.x[:, 0]
    limits = np.array([KEEPING_SPEEDS, OVERTAKING_SPEEDS])[phases(experiment)] / KMH
    held: Any = {"drawstyle": "steps-post"}
    for limit in limits.T:
        axes.plot(x, limit, color=LIMIT, linewidth=1.1, linestyle=_DASHED, **held)
    reference = experiment.signals["speed_reference"] / KMH
    axes.plot(x, reference, color=GOOD, linewidth=1.2, linestyle=(0, (1, 1.5)), **held)
    axes.plot(x, experiment.u[:, 0] / KMH, color=run.color, **held)
    axes.set_ylim(36, 74)
    axes.set_ylabel("speed [km/h]")
    axes.set_title("Speed $v$, its reference (dotted) and limits (dashed)")


def _steering(axes: Axes, run: Shown) -> None:
    experiment = run.experiment
    for limit in (-STEERING_LIMIT, STEERING_LIMIT):
        axes.axhline(limit, color=LIMIT, linewidth=1.1, linestyle=_DASHED)
    x, steering = experiment.x[:, 0], np.degrees(experiment.u[:, 1])
    axes.plot(x, steering, color=run.color, drawstyle="steps-post")
    axes.set_ylim(-52, 52)
    axes.set_yticks([-45, 0, 45])
    axes.set_ylabel("steering angle [°]")
    axes.set_title(r"Steering angle $\delta_s$ and its limits (dashed)")


def _stacked(axes: Axes, run: Shown, window: float) -> None:
    """Draw one road for each moment, to scale, in the order of time from above."""
    low, high = road_of(run.experiment)
    each = high - low + _CAPTION
    for row, moment in enumerate(moments(run.experiment)):
        offset = -each * row
        _strip(axes, run, moment, offset)
        when = f"{run.experiment.t[moment.index]:.1f} s"
        words = " · ".join(filter(None, (moment.name, when)))
        axes.text(
            -window / 2, offset + high + 0.7, f"{row + 1}  {words}", fontsize=7.6, color=FAINT
        )
    axes.set_aspect("equal", anchor="W")
    axes.set_xlim(-window / 2, window / 2)
    axes.set_ylim(-4 * each + low - 0.3, high + _CAPTION)
    axes.set_axis_off()


def _strip(axes: Axes, run: Shown, moment: Moment, offset: float) -> None:
    """Draw the cars at a moment on the road around them; x counts from the middle of them."""
    experiment, now = run.experiment, moment.index
    own, others = experiment.x[now, :3], bodies(experiment)[:, now]
    x = float(own[0])
    nearest = min(others[:, 0].tolist(), key=lambda x_o: abs(x_o - x), default=x)
    moved = np.array([-(x + nearest - LENGTH) / 2, offset])
    _road(axes, road_of(experiment), (-_SEEN, _SEEN), offset)
    axes.plot(*(experiment.x[:, :2] + moved).T, color=run.color, linewidth=1.0, alpha=0.45)
    for pose, color in [*((other, OBSTACLE) for other in others), (own, run.color)]:
        axes.fill(*(corners(pose[None])[0] + moved).T, color=color, linewidth=0, zorder=3)


def _road(
    axes: Axes, edges: tuple[float, float], ends: tuple[float, float], offset: float = 0.0
) -> None:
    """Draw asphalt, edges and the broken lines between lanes, from one x to another [m]."""
    low, high = edges
    axes.fill_between(ends, low + offset, high + offset, color=ASPHALT, linewidth=0, zorder=0)
    look: Any = {"color": PAINT, "linewidth": 1.2, "zorder": 1}
    axes.hlines(np.array(edges) + offset, *ends, **look)
    between = np.arange(low + LANE_WIDTH, high - LANE_WIDTH / 2, LANE_WIDTH)
    axes.hlines(between + offset, *ends, linestyle=_DASHED, **look)


def _alt(record: Record) -> str:
    assert record.best is not None
    experiment = record.best.experiment
    kpis = experiment.kpis
    beside = f", beside the {record.baseline.name}" if len(shown(record)) > 1 else ""
    return (
        "Path with the vehicles at five moments, speed and steering angle along the road, of the "
        f"best run{beside}. "
        f"Best: {theta_text(record.scenario.space, experiment.theta)}; worst t_comp "
        f"{number(kpis['t_comp_worst'])} s, smallest lateral distance beside the obstacle "
        f"{number(kpis['lateral_distance'])} m, largest y_f {number(kpis['path_peak'])} m."
    )


PICTURE = Picture(
    "overtaking.png",
    "The overtaking",
    "The best run, and to the right the one before if it is another. Numbers mark five moments of "
    "the overtaking, as far as the run reached them; the roads below show the vehicles there, to "
    "scale. Limits and reference of the speed change with the phase. t_comp is modeled.",
    _alt,
    lambda record: drawn(shown(record), record.scenario.space),
)
