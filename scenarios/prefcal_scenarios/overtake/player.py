"""The scrubber of report.html: the runs drawn as SVG from embedded positions, and moved."""

import json
from collections.abc import Iterator
from html import escape
from importlib.resources import files

import numpy as np

from prefcal_env.experiment import Experiment
from prefcal_env.overtaking import LANE_WIDTH, LENGTH, WIDTH
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.overtake.film import Instant, instant
from prefcal_scenarios.overtake.moments import moments
from prefcal_scenarios.overtake.scene import lines_of, obstacles, road_of
from prefcal_scenarios.overtake.shown import DASH, OBSTACLE, PERIOD, Shown, runs
from prefcal_scenarios.report.record import Record

STEP = 0.1
"""Between embedded positions [s]; between them the script moves the cars linearly."""
_BEHIND, _SEEN = 42.0, 84.0
"""What is seen behind the front end, and in all [m]."""


def player(record: Record) -> str:
    """HTML of the animation: pictures, controls, positions, style and script, nothing else needed.

    Without scripts the runs stand still beside the obstacle.
    """
    shown = runs(record)
    last = max(float(s.experiment.t[-1]) for s in shown)
    still = float(shown[0].experiment.t[moments(shown[0].experiment)[2].index])
    data = {
        "step": STEP,
        "still": round(still, 2),
        "runs": [_positions(s.experiment) for s in shown],
    }
    resource = files("prefcal_scenarios.overtake")
    css, script = (
        resource.joinpath(f"player.{kind}").read_text(encoding="utf-8") for kind in ("css", "js")
    )
    scenes = "\n".join("\n".join(_scene(s, still)) for s in shown)
    return (
        f'<style>\n{css}</style>\n<div class="player" role="group" aria-label="Animation">\n'
        f"{scenes}\n{_controls(last, still)}\n"
        f'<script type="application/json">{json.dumps(data, separators=(",", ":"))}</script>\n'
        f"</div>\n<script>\n{script}</script>"
    )


def _controls(last: float, still: float) -> str:
    return (
        '<div class="controls" hidden>'
        '<button type="button" aria-label="Play">▶</button>'
        f'<input type="range" min="0" max="{last:.2f}" step="0.05" value="{still:.2f}" '
        f'aria-label="Time in seconds" aria-valuetext="{still:.1f} s">'
        f'<output aria-hidden="true">{still:.1f} s</output></div>'
    )


def scene(experiment: Experiment) -> dict[str, object]:
    """What the query window animates: the road, the size of the cars [m], and their positions."""
    road = list(road_of(experiment))
    road_and_cars = {"kind": "road", "road": road, "lane": LANE_WIDTH, "size": [LENGTH, WIDTH]}
    return {**road_and_cars, "step": STEP, **_positions(experiment)}


def _positions(experiment: Experiment) -> dict[str, object]:
    """Columns of x, y [m], heading [°], speed [km/h], then x, y of each obstacle."""
    last = experiment.duration
    return {
        "end": round(last, 3),
        "stopped": experiment.end.interrupted,
        "rows": _rows(experiment, last) if len(experiment.t) else [],
    }


def _rows(experiment: Experiment, last: float) -> list[list[float]]:
    """Every row at once: a question waits for its scenes."""
    at, t, x = np.append(np.arange(0.0, last, STEP), last), experiment.t, experiment.x
    held = np.maximum(np.searchsorted(t, at + 1e-9, side="right") - 1, 0)
    columns = [np.interp(at, t, x[:, i]) for i in range(3)]
    columns[2] = np.degrees(columns[2])
    columns.append(experiment.u[held, 0] / KMH)
    columns += [np.interp(at, t, c) for other in obstacles(experiment) for c in other.T]
    rows: list[list[float]] = (np.round(np.column_stack(columns), 2) + 0.0).tolist()
    return rows


def _row(now: Instant) -> list[float]:
    x, y, heading = now.pose.tolist()
    values = [x, y, float(np.degrees(heading)), now.speed, *now.others.ravel().tolist()]
    return [round(v, 2) + 0.0 for v in values]


def _scene(shown: Shown, time: float) -> Iterator[str]:
    """One run at `time`: y upwards becomes downwards, the world moves under the camera."""
    now = instant(shown.experiment, time)
    low, high = road_of(shown.experiment)
    x, y, heading, speed, *others = _row(now)
    yield (
        f'<div class="run"><p><strong style="color:{shown.color}">{escape(shown.label)}</strong> '
        f'<span class="now">{speed:.0f} km/h</span></p>'
    )
    yield (
        f'<svg viewBox="0 {-high - 0.4:g} {_SEEN:g} {high - low + 4:g}" role="img" '
        f'aria-label="Top view of the {escape(shown.label)} run: the car and the obstacle">'
    )
    yield f'<g class="world" transform="translate({_BEHIND - x:.2f} 0)">'
    yield from _road(shown.experiment)
    yield f'<polyline class="path" points="{_path(shown.experiment)}" stroke="{shown.color}"/>'
    for i in range(0, len(others), 2):
        yield _car("other", others[i], others[i + 1], 0.0, OBSTACLE)
    yield _car("own", x, y, heading, shown.color)
    yield "</g></svg></div>"


def _road(experiment: Experiment) -> Iterator[str]:
    start, end = -_SEEN, float(experiment.x[:, 0].max()) + _SEEN
    low, high = road_of(experiment)
    yield (
        f'<rect class="asphalt" x="{start:g}" y="{-high:g}" width="{end - start:.1f}" '
        f'height="{high - low:g}"/>'
    )
    for y in (low, high):
        yield f'<path class="paint" d="M{start:g} {-y:g}H{end:.1f}"/>'
    for y in lines_of((low, high)):
        yield (
            f'<path class="paint" d="M{start:g} {-y:g}H{end:.1f}" '
            f'stroke-dasharray="{DASH:g} {PERIOD - DASH:g}"/>'
        )
    for mark in range(-80, int(end), 20):
        yield f'<path class="paint" d="M{mark} {-low:g}v0.4"/>'
        yield f'<text x="{mark}" y="{-low + 2:g}">{mark} m</text>'


def _path(experiment: Experiment) -> str:
    thin = experiment.x[:: max(1, len(experiment.t) // 400), :2]
    return " ".join(f"{x:.2f},{-y:.2f}" for x, y in thin.tolist())


def _car(kind: str, x: float, y: float, heading: float, color: str) -> str:
    """Front end at the origin, to the right."""
    half = WIDTH / 2
    return (
        f'<g class="{kind}" transform="translate({x:.2f} {-y:.2f}) rotate({-heading:.2f})">'
        f'<rect class="body" x="{-LENGTH}" y="{-half}" width="{LENGTH}" height="{WIDTH}" rx="0.3" '
        f'style="fill:{color}"/>'
        '<path class="glass" d="M-1.2 -.72Q-1 0-1.2 .72L-1.9 .58V-.58Z"/>'
        '<path class="glass" d="M-3.95 -.6V.6L-3.55 .5V-.5Z"/></g>'
    )
