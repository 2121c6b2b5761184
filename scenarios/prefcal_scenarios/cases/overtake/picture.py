"""Draw overtakings: path, speed and steering along the road, with the cars at five moments."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_env.envs.overtake.scene import KEEPING_SPEEDS, LANE_WIDTH, LENGTH, OVERTAKING_SPEEDS, corners
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import KnobSpace
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.scenario import Picture
from prefcal_scenarios.style import BEST, FAINT, FIRST, GOOD, LIMIT, OTHERS, above, canvas
from prefcal_scenarios.wording import mathtext, number, quantity, theta_text

from .kpis import moments, obstacles, phases, road_of

OBSTACLE, ASPHALT, PAINT = OTHERS[0], "#eceff2", "#aab3bc"
_DASHED: Any = (0, (6, 3))


@dataclass(frozen=True, slots=True)
class ShownDrive:
    """A run to draw, its label and its color."""

    experiment: Experiment
    label: str
    color: str


def shown(record: Any) -> tuple[ShownDrive, ...]:
    """Return the best run and the one before; one run if they are the same."""
    best, before = record.result, record.before
    runs = (ShownDrive(best.experiment, f"best (experiment {best.number})", BEST),)
    if best.index == before.index:
        return runs
    label = f"{record.baseline} ({before.number})"
    return *runs, ShownDrive(before.experiment, label, FIRST)


def drawn(runs: Sequence[ShownDrive], space: KnobSpace) -> Figure:
    """Draw one run or two side by side, as in Fig. car_comparison and Fig. car_finalPerf."""
    figure = canvas(7.0)
    axes = figure.subplots(3, len(runs), sharey="row", squeeze=False)
    last = max(float(run.experiment.x[:, 0].max()) for run in runs)
    for column, run in enumerate(runs):
        path, speed, steering = axes[:, column]
        _path(path, run)
        _speed(speed, run)
        _steering(steering, run)
        steering.set_xlabel("longitudinal position [m]")
        above(path, _theta_lines(space, run), 20, color=FAINT, fontsize=8.2)
        above(path, _computing(run.experiment), 47, fontsize=8.8)
        above(path, run.label, 62, color=run.color, fontweight="bold")
    for axis in axes.flat:
        axis.set_xlim(-LENGTH, last + 5)
    for axis in axes[:, 1:].flat:
        axis.set_ylabel("")
    figure.align_ylabels(axes[:, 0])
    return figure


def _theta_lines(space: KnobSpace, run: ShownDrive) -> str:
    """Return θ in mathtext, on two lines."""
    pairs = zip(space, run.experiment.theta, strict=True)
    parts = [f"{mathtext(k.name)} = {quantity(v, k.unit)}" for k, v in pairs]
    return ",  ".join(parts[:3]) + "\n" + ",  ".join(parts[3:])


def _computing(experiment: Experiment) -> str:
    """Return the worst modeled t_comp compared with T_s, as text."""
    worst, T_s = experiment.kpis["t_comp_worst"], experiment.theta[0]
    sign = "≤" if worst <= T_s else ">"
    return f"worst $t_{{comp}}$ {1e3 * worst:.0f} ms {sign} $T_s$ {1e3 * T_s:.0f} ms"


def _path(axes: Axes, run: ShownDrive) -> None:
    """Draw the road, both paths, and the cars at five moments, which have a number."""
    experiment, (low, high) = run.experiment, road_of(run.experiment)
    axes.axhspan(low, high, color=ASPHALT, zorder=0)
    look: Any = {"color": PAINT, "linewidth": 1.2, "zorder": 1}
    for y in np.arange(low, high + 1e-9, LANE_WIDTH):
        axes.axhline(y, linestyle="-" if y in (low, high) else _DASHED, **look)
    cars = [*((other, OBSTACLE) for other in obstacles(experiment)), (experiment.x, run.color)]
    for poses, color in cars:
        axes.plot(*poses[:, :2].T, color=color, linewidth=1.0, alpha=0.6)
        for n, k in enumerate(moments(experiment), start=1):
            body = corners(poses[k : k + 1])[0]
            axes.fill(*body.T, color=color, linewidth=0, zorder=3)
            at: Any = {"ha": "center", "va": "center_baseline", "fontsize": 7, "fontweight": "bold"}
            axes.annotate(str(n), body.mean(axis=0), color="white", **at)
    axes.set_yticks([0, 3, 6])
    axes.set_ylabel("lateral position [m]")
    axes.grid(visible=False)
    axes.set_title("Path of the car and of the obstacle (orange)")


def _speed(axes: Axes, run: ShownDrive) -> None:
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


def _steering(axes: Axes, run: ShownDrive) -> None:
    x, steering = run.experiment.x[:, 0], np.degrees(run.experiment.u[:, 1])
    for limit in (-45, 45):
        axes.axhline(limit, color=LIMIT, linewidth=1.1, linestyle=_DASHED)
    axes.plot(x, steering, color=run.color, drawstyle="steps-post")
    axes.set_ylim(-52, 52)
    axes.set_yticks([-45, 0, 45])
    axes.set_ylabel("steering angle [°]")
    axes.set_title(r"Steering angle $\delta_s$ and its limits (dashed)")


def _alt(record: Any) -> str:
    experiment = record.result.experiment
    kpis = experiment.kpis
    beside = f", beside the {record.baseline}" if len(shown(record)) > 1 else ""
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
    "The best run, and to the right the one before if it is another. Numbers mark five moments, "
    "equally spaced in time. Limits and reference of the speed change with the phase. t_comp is "
    "modeled.",
    _alt,
    lambda record: drawn(shown(record), record.scenario.space),
)
