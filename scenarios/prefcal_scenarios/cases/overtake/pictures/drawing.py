"""Describe an overtaking seen from above as data: every picture and animation draws this.

Lengths are in meters, x along the road and y to the left. Matplotlib draws a `Frame` (see
`roads`); browsers get `Drawing.as_json` and move its bodies themselves (see `road.js`).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.rules import LENGTH, WIDTH
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.cases.overtake.scene import bodies, lines_of, road_of

STEP = 0.1
"""Time between the positions that browsers get [s]; they move the cars linearly between them."""
DASH, PERIOD = 6.0, 12.0
"""Length of a dash between the lanes, and from one dash to the next [m]."""
EVERY = 20.0
"""Distance from one distance mark to the next [m]."""
_RADIUS = 0.3
"""Radius of a body's corners [m]."""

Points = Float[np.ndarray, "m 2"]


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """A filled area; `role` says what it is: asphalt, other, own (both cars), or glass."""

    role: str
    points: Points


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """An open line; `role` is paint, path (where the car drives) or trace (where it has been)."""

    role: str
    points: Points


@dataclass(frozen=True, slots=True)
class Label:
    """A distance mark at `x` on the right edge of the road."""

    text: str
    x: float


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Everything visible at one time, in the order in which it is drawn."""

    polygons: tuple[Polygon, ...]
    lines: tuple[Line, ...]
    labels: tuple[Label, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """Positions of all vehicles at one time.

    Args:
        own: Pose of the own car (x_f, y_f [m], heading [rad]).
        speed: Speed of the own car [km/h].
        others: Poses of the obstacles.
    """

    own: Float[np.ndarray, " 3"]
    speed: float
    others: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """A whole run on its road.

    Args:
        road: Right and left edge of the road, y [m].
        t: Times of the record [s].
        own: Poses of the own car on `t`.
        speed: Its speed on `t`, held in between [km/h].
        others: Poses of each obstacle on `t`.
        stopped: Whether the run was interrupted.
    """

    road: tuple[float, float]
    t: Float[np.ndarray, " K"]
    own: Float[np.ndarray, "K 3"]
    speed: Float[np.ndarray, " K"]
    others: Float[np.ndarray, "n K 3"]
    stopped: bool

    @classmethod
    def of(cls, experiment: Experiment) -> "Drawing":
        """Return the drawing of an overtaking experiment."""
        return cls(
            road_of(experiment),
            experiment.t,
            experiment.x[:, :3],
            experiment.u[:, 0] / KMH,
            bodies(experiment),
            experiment.end.interrupted,
        )

    def at(self, time: float) -> Instant:
        """Return where everything is at `time` [s]; after the end, return the last positions."""
        rows = self._rows(np.array([time]))[0]
        others = rows[4:].reshape(-1, 3)
        return Instant(rows[:3], float(rows[3]), others)

    def ground(self, start: float, end: float) -> Frame:
        """Return the road alone between two x [m]: asphalt, edges, dashes and distance marks."""
        low, high = self.road
        asphalt = np.array([[start, low], [end, low], [end, high], [start, high]])
        edges = [np.array([[start, y], [end, y]]) for y in self.road]
        dashes = [
            np.array([[max(x, start), y], [min(x + DASH, end), y]])
            for y in lines_of(self.road)
            for x in np.arange(np.floor(start / PERIOD) * PERIOD, end, PERIOD)
            if x + DASH > start
        ]
        marks = np.arange(np.ceil(start / EVERY) * EVERY, end, EVERY)
        return Frame(
            (Polygon("asphalt", asphalt),),
            tuple(Line("paint", points) for points in (*edges, *dashes)),
            tuple(Label(f"{x + 0.0:.0f} m", float(x)) for x in marks),
        )

    def frame(self, time: float, start: float, end: float) -> Frame:
        """Return everything that is seen at `time` [s] between two x [m]."""
        now, ground = self.at(time), self.ground(start, end)
        return Frame(
            (*ground.polygons, *_vehicles(now)), (*ground.lines, *self._paths(time, start, end)),
            ground.labels,
        )  # fmt: skip

    def as_json(self) -> dict[str, object]:
        """Return the whole run for `road.js`, as data for JSON.

        `body` holds the polygons of a car whose front end is at the origin and that drives
        along x. The columns of `rows`, one row every `step` seconds and one at `end`, are x, y,
        heading [°] and speed [km/h] of the own car, then x, y, heading [°] of each obstacle.
        """
        last = float(self.t[-1]) if len(self.t) else 0.0
        rows: list[list[float]] = []
        if len(self.t):
            columns = self._rows(np.append(np.arange(0.0, last, STEP), last))
            angles = [2, *range(6, columns.shape[1], 3)]
            columns[:, angles] = np.degrees(columns[:, angles])
            rows = (np.round(columns, 2) + 0.0).tolist()
        return {
            "kind": "road",
            "road": list(self.road),
            "lines": lines_of(self.road),
            "dash": [DASH, PERIOD - DASH],
            "every": EVERY,
            "body": [{"role": p.role, "points": np.round(p.points, 3).tolist()} for p in BODY],
            "step": STEP,
            "end": round(last, 3),
            "stopped": self.stopped,
            "rows": rows,
        }

    def _rows(self, times: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m c"]:
        """Return x, y, heading [rad], speed, then x, y, heading of each obstacle at `times`.

        All times are computed at once, since a question waits for its scenes.
        """
        held = np.maximum(np.searchsorted(self.t, times + 1e-9, side="right") - 1, 0)
        columns = [np.interp(times, self.t, column) for column in self.own.T]
        columns.append(self.speed[held])
        columns += [np.interp(times, self.t, c) for other in self.others for c in other.T]
        return np.column_stack(columns)

    def _paths(self, time: float, start: float, end: float) -> Iterator[Line]:
        """Yield the path of the whole run and the part that was driven until `time`."""
        seen = (self.own[:, 0] >= start) & (self.own[:, 0] <= end)
        yield Line("path", self.own[seen, :2])
        driven = self.own[seen & (self.t <= time), :2]
        here = self.at(time).own[:2]
        yield Line("trace", np.vstack([driven, here]))


def animation(experiment: Experiment) -> dict[str, object]:
    """Return the animation of an experiment for the query window; see `Drawing.as_json`."""
    return Drawing.of(experiment).as_json()


def _vehicles(now: Instant) -> Iterator[Polygon]:
    """Yield the polygons of the obstacles, then those of the own car."""
    for role, pose in [*(("other", other) for other in now.others), ("own", now.own)]:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        for part in BODY:
            points = part.points @ np.array([[c, s], [-s, c]]) + pose[:2]
            yield Polygon(role if part.role == "body" else part.role, points)


def _body() -> tuple[Polygon, ...]:
    """Return a car to scale: outline with round corners, windscreen and rear window."""
    half, turn = WIDTH / 2, np.linspace(0, np.pi / 2, 4)
    arc = _RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    centers = ((-_RADIUS, 1), (_RADIUS - LENGTH, 1), (_RADIUS - LENGTH, -1), (-_RADIUS, -1))
    corners = []
    for k, (x, side) in enumerate(centers):
        c, s = np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)
        turned = arc @ np.array([[c, s], [-s, c]])
        corners.append(turned + np.array([x, side * (half - _RADIUS)]))
    windscreen = np.array([[-1.2, -0.72], [-1.0, 0.0], [-1.2, 0.72], [-1.9, 0.58], [-1.9, -0.58]])
    rear = np.array([[-3.95, -0.6], [-3.95, 0.6], [-3.55, 0.5], [-3.55, -0.5]])
    return Polygon("body", np.vstack(corners)), Polygon("glass", windscreen), Polygon("glass", rear)


BODY = _body()
"""Polygons of a car whose front end is at the origin and that drives along x."""
