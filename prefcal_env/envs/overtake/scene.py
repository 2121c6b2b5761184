"""The scene of section IV-B: its rules, options, bodies on the road, and the other vehicles."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from enum import IntEnum
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.arrays import number_in, plant_vector
from prefcal_env.errors import SettingsError
from prefcal_env.jit import inner, kernel
from prefcal_env.plants.bicycle import KMH, Bicycle

# --- Overtaking of section IV-B: its constants, when to overtake, and what a state costs.
#
# Positions are those of front ends on the center line: x ahead, y to the left [m].

Position = TypeVar("Position", float, np.ndarray[Any, Any])  # one position x [m], or several, shape (n,)

LENGTH, WIDTH = 4.5, 1.8  # length and width of every vehicle [m]
LANE_WIDTH = 4.0  # width of each of the two lanes, centered at y = 0 and `LANE_WIDTH` [m]; not in the paper
ROAD = (-LANE_WIDTH / 2, 1.5 * LANE_WIDTH)  # right and left edge of the road, y [m]
SAFETY_DISTANCE = 10.0
"""Overtaking begins when the gap falls below it and ends when it is as large behind [m]."""
MIN_LATERAL_DISTANCE = 3.0  # smallest distance between the center lines while overtaking [m]
T_S_RANGE = (0.085, 0.5)  # range of sampling times [s]
LOW, HIGH = np.array([(c.low, c.high) for c in Bicycle.inputs]).T
"""Limits of v [m/s] and δ_s [rad] of the ego vehicle."""
KEEPING_SPEED, OVERTAKING_SPEED = 50 * KMH, 60 * KMH  # references of v in the two phases [m/s]
KEEPING_SPEEDS, OVERTAKING_SPEEDS = (40 * KMH, 70 * KMH), (50 * KMH, 70 * KMH)
"""Limits of v in the two phases [m/s]."""
OBSTACLE_SPEED = 40 * KMH  # constant speed of the paper's obstacle [m/s]
MISHAP_COST = 10.0
"""Stage cost for the rest of the horizon after a mishap [1/s]: no reasonable state costs as much,
so it never pays to end an episode."""


class DrivePhase(IntEnum):
    """Phase of the drive: what the ego vehicle is doing."""

    LANE_KEEPING = 0
    OVERTAKING = 1


def next_phase(phase: DrivePhase, x_f: float, obstacles: Float[np.ndarray, "n 3"]) -> DrivePhase:
    """Return the phase at this sampling instant, given the previous one (at first lane keeping).

    Source: section IV-B, "within safety distance"; geometry as stated in `gap` and `clearance`.
    Overtaking begins when 0 < gap < 10 m and lasts until the clearance is above 10 m.
    With several obstacles this holds for each in turn: once one is passed, overtaking ends unless
    the next is within 10 m; before that, falling back does not end it. Obstacles in the left lane
    cannot be overtaken and are ignored.

    Args:
        phase: Phase at the previous sampling instant.
        x_f: Front end of the ego vehicle [m].
        obstacles: (x_o, y_o [m], v_o [m/s]) of each obstacle, shape (n, 3); n may be 0.
    """
    ahead = [x_o for x_o, y_o, _ in obstacles.tolist() if y_o < LANE_WIDTH / 2]
    if phase is DrivePhase.LANE_KEEPING:
        begins = any(0 < gap(x_f, x_o) < SAFETY_DISTANCE for x_o in ahead)
        return DrivePhase.OVERTAKING if begins else DrivePhase.LANE_KEEPING
    to_pass = [x_o for x_o in ahead if clearance(x_f, x_o) <= SAFETY_DISTANCE]
    none_passed = len(to_pass) == len(ahead)
    goes_on = any(none_passed or gap(x_f, x_o) < SAFETY_DISTANCE for x_o in to_pass)
    return DrivePhase.OVERTAKING if goes_on else DrivePhase.LANE_KEEPING


def beside(x_f: float, obstacles: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Return the obstacles to keep `MIN_LATERAL_DISTANCE` from: right lane, 10 m ahead or behind.

    `x_f` and `obstacles` are as in `next_phase`; there may be none.
    """
    near = [
        gap(x_f, x_o) < SAFETY_DISTANCE and clearance(x_f, x_o) <= SAFETY_DISTANCE and y_o < LANE_WIDTH / 2
        for x_o, y_o, _ in obstacles.tolist()
    ]
    return obstacles[near]


def gap(x_f: float, x_o: Position) -> Position:
    """Return the distance from the ego front end to the obstacle's rear, x_o - 4.5 - x_f [m]."""
    return x_o - LENGTH - x_f


def clearance(x_f: float, x_o: Position) -> Position:
    """Return the distance from the obstacle's front end to the ego rear, x_f - 4.5 - x_o [m]."""
    return x_f - LENGTH - x_o


def stage_cost(
    t: Float[np.ndarray, " M"], y: Float[np.ndarray, " M"], u: Float[np.ndarray, " 2"], phase: DrivePhase
) -> float:
    """Return the cost of a period, 1/s: (Δv/20 km/h)² + mean of (Δy/3 m)² + (δ_s/45°)².

    Δv and Δy are the distances from 50 km/h and the ego lane, or while overtaking from 60 km/h and
    3 m to the left of it. Multiplied by the duration, the cost does not depend on T_s. `t` are the
    instants of the period, with both ends [s], `y` is y_f then [m], `u` are the held v [m/s] and
    δ_s [rad], `phase` is that of its start.
    """
    overtaking = phase is DrivePhase.OVERTAKING
    v_ref = OVERTAKING_SPEED if overtaking else KEEPING_SPEED
    y_ref = MIN_LATERAL_DISTANCE if overtaking else 0.0
    error = ((y - y_ref) / MIN_LATERAL_DISTANCE) ** 2
    lane = np.trapezoid(error, t) / (t[-1] - t[0]) if len(t) > 1 else error[0]
    v, steering = u.tolist()
    speed = ((v - v_ref) / (20 * KMH)) ** 2
    return float(speed + lane + (steering / (np.pi / 4)) ** 2)


DRIVERS = tuple(
    f"highway_env.vehicle.behavior.{name}"
    for name in ("IDMVehicle", "LinearVehicle", "AggressiveVehicle", "DefensiveVehicle")
)
"""Types of drivers in highway-env."""


@dataclass(frozen=True, slots=True)
class OvertakeOptions:
    """The scene of the overtaking; the defaults are the paper's.

    The traffic besides the paper's obstacle is highway-env's own: `vehicles_count` drivers, placed
    and made random by highway-env from the seed of `reset`, one ahead of the other.

    Args:
        x0: Initial pose of the ego vehicle: x_f, y_f [m] and θ [rad].
        duration: Duration: an episode lasts until the first sample at or after it [s].
        lanes_count: Number of lanes, 4 m wide; ours is the rightmost, at y = 0.
        vehicles_count: Number of drivers ahead of the obstacle.
        vehicles_density: Density of these drivers, as in highway-env.
        other_vehicles_type: Type of these drivers, one of `DRIVERS`.
        simulation_frequency: Frequency of their decisions [Hz]; at least one per period.
        wheelbase: Distance of the axles of the car [m]; a controller need not know it.

    Raises:
        SettingsError: If a number is out of range or the type is unknown.
    """

    x0: tuple[float, float, float] = (0.0, 0.0, 0.0)
    duration: float = 15.0
    lanes_count: int = 2
    vehicles_count: int = 0
    vehicles_density: float = 1.0
    other_vehicles_type: str = DRIVERS[0]
    simulation_frequency: float = 15.0
    wheelbase: float = Bicycle().length

    def __post_init__(self) -> None:
        object.__setattr__(self, "x0", tuple(plant_vector(self.x0, 3, "initial pose x0").tolist()))
        number_in(self.duration, (0.5, 3600.0), "duration [s]")
        number_in(self.vehicles_density, (0.01, 100.0), "vehicles_density")
        number_in(self.wheelbase, (0.5, 50.0), "wheelbase [m]")
        number_in(self.simulation_frequency, (1.0, 1000.0), "simulation_frequency [Hz]")
        for name, low, high in (("lanes_count", 1, 10), ("vehicles_count", 0, 1000)):
            count = getattr(self, name)
            if not isinstance(count, int) or isinstance(count, bool) or not low <= count <= high:
                raise SettingsError(f"{name} must be a whole number in [{low}, {high}], got {count!r}")
        if self.other_vehicles_type not in DRIVERS:
            raise SettingsError(
                f"other_vehicles_type must be one of {DRIVERS}, got {self.other_vehicles_type!r}"
            )

    @property
    def road(self) -> tuple[float, float]:
        """Right and left edge of the road, y [m]."""
        return -LANE_WIDTH / 2, (self.lanes_count - 0.5) * LANE_WIDTH

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> "OvertakeOptions":
        """Return the scene of a configuration, plain data; missing keys are as in the paper.

        Raises:
            SettingsError: If a key is unknown or a value has the wrong type.
        """
        known = {f.name for f in fields(cls)}
        unknown = sorted(set(config) - known)
        if unknown:
            raise SettingsError(f"a scene has unknown keys {unknown}, expected some of {sorted(known)}")
        return cls(**config)


def paper_scene() -> dict[str, Any]:
    """Return the configuration of the paper's scene, with all keys."""
    options = asdict(OvertakeOptions())
    return options | {"x0": list(options["x0"])}


# --- Bodies on the road: rectangles of 4.5 x 1.8 m, each a pose (x, y [m], heading [rad]).
#
# A pose is that of the front end on the center line, so the body's center is 2.25 m behind it. Headings
# are counterclockwise from the road's direction; y is to the left.
#
# What a period asks for at each instant is compiled: in numpy a period, which has a few instants only,
# takes 20 times as long.

_LONG, _BROAD = LENGTH / 2, WIDTH / 2
_ROUNDING = 1e-9  # distance far above rounding errors and far below any that matters [m]

REACH = float(np.hypot(LENGTH, WIDTH / 2))
"""Distance from the front end to the farthest point of the body [m]."""
CONTACT = 1e-3  # distance below which bodies have touched [m]
BENT = 1.1  # factor by which a path between two close instants may be longer than its chord

Times = Float[np.ndarray, " K"]
Poses = Float[np.ndarray, "K 3"]
Motion = Callable[[Times], tuple[Poses, list[Poses]]]
"""Maps instants, shape (K,), to the poses of the ego body and of each other body, (K, 3)."""


def separation(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return a lower bound on the distance of the bodies at `a` and `b` [m], shape (K,).

    At most 0 means that they touch. This is the largest gap between their projections on the four
    directions of their sides: never more than their distance, and positive exactly when they are
    disjoint (separating axes).
    """
    return np.asarray(separations(_plain(a), _plain(b)))


def distance(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return the distance of the outlines of the bodies at `a` and `b` [m], shape (K,).

    It is always at a corner of one of them, and 0 if a corner of one is in the other.
    """
    return np.asarray(distances(_plain(a), _plain(b)))


def corners(poses: Poses) -> Float[np.ndarray, "K 4 2"]:
    """Return the corners (x, y) [m]: front left, rear left, rear right, front right."""
    forward = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    half = WIDTH / 2
    sides = [(0, half), (-LENGTH, half), (-LENGTH, -half), (0, -half)]
    return np.stack([poses[:, :2] + a * forward + b * left for a, b in sides], axis=1)


def outside(poses: Poses, road: tuple[float, float] = ROAD) -> Float[np.ndarray, " K"]:
    """Return how far the outermost corner is off the road [m], shape (K,); negative if inside.

    `road` is the right and the left edge of the road, y [m].
    """
    return np.asarray(outsides(_plain(poses), road))


def lateral_distance(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return the distance between the center lines of bodies alongside each other [m], (K,).

    This is abs(y_f - y_o) if abs(x_f - x_o) < 4.5 m, and NaN otherwise.
    """
    alongside = np.abs(a[:, 0] - b[:, 0]) < LENGTH
    return np.where(alongside, np.abs(a[:, 1] - b[:, 1]), np.nan)


def first_contact(motion: Motion, times: Times) -> float | None:
    """Return when the ego body first touches another within `times`; None if it does not.

    Bodies can touch between two instants only if together they move by more than their distance
    (see `separation`) at both. If so, the instants in the middle are checked too, until a contact
    is ruled out or the motion is below `CONTACT`. So no contact is missed, and the returned time
    is that of the first one up to a motion of `CONTACT`.

    Args:
        motion: Function that returns the poses at any instants within `times`.
        times: Increasing instants, shape (K,), K >= 2, so close that no body turns by 1 rad in
            between.
    """
    while True:
        own, others = motion(times)
        apart = np.min([separation(own, other) for other in others], axis=0)
        if apart[0] <= 0:
            return float(times[0])
        touching = np.flatnonzero(apart <= 0)
        n = int(touching[0]) + 1 if len(touching) else len(times)  # ignore what happens later
        moved = _travel(own) + np.max([_travel(other) for other in others], axis=0)
        may_touch = (apart[:-1] + apart[1:] <= moved) | (apart[1:] <= 0)
        possible = np.flatnonzero(may_touch[: n - 1])
        if not len(possible):
            return None
        if moved[possible[0]] < CONTACT:
            return float(times[possible[0] + 1])
        # From the first interval with a possible contact to the last one.
        first, last = possible[0], possible[-1] + 2
        middles = (times[possible] + times[possible + 1]) / 2
        times = np.sort(np.concatenate([times[first:last], middles]))


def _travel(poses: Poses) -> Float[np.ndarray, " K-1"]:
    """Return a lower bound on the motion of any point of a body between instants [m]."""
    step = np.diff(poses, axis=0)
    return np.asarray(BENT * (np.hypot(step[:, 0], step[:, 1]) + REACH * np.abs(step[:, 2])))


def _plain(poses: Poses) -> Poses:
    """Return a copy: for read-only or strided arrays, kernels would be compiled again."""
    return np.array(poses, dtype=float, order="C")


@kernel()
def separations(a, b):  # type: ignore[no-untyped-def]
    """Return `separation`, shape (K,)."""
    apart = np.empty(len(a))
    for i in range(len(a)):
        apart[i] = _separation(a[i, 0], a[i, 1], a[i, 2], b[i, 0], b[i, 1], b[i, 2])
    return apart


@kernel()
def distances(a, b):  # type: ignore[no-untyped-def]
    """Return `distance`, shape (K,)."""
    apart = np.empty(len(a))
    for i in range(len(a)):
        apart[i] = _to_corners(b, a, i, _to_corners(a, b, i, np.inf))
    return apart


@kernel()
def outsides(poses, road):  # type: ignore[no-untyped-def]
    """Return `outside`, shape (K,)."""
    off = np.empty(len(poses))
    for i in range(len(poses)):
        off[i] = _outside(poses[i, 1], poses[i, 2], road)
    return off


@kernel()
def kept(x, road, margin):  # type: ignore[no-untyped-def]
    """Return how many instants after the first to keep, and whether the last one is off the road.

    Args:
        x: States at the M + 1 instants, shape (M + 1, n_x); the first ones are the pose.
        road: Right and left edge of the road, y [m].
        margin: Distance off the road at which a body has left it [m].
    """
    for i in range(1, len(x)):
        if _outside(x[i, 1], x[i, 2], road) > margin:
            return i, True
    return len(x) - 1, False


@kernel()
def surely_apart(x, others):  # type: ignore[no-untyped-def]
    """Return whether `first_contact` rules out a contact at first sight.

    Args:
        x: States at the M + 1 instants, shape (M + 1, n_x); the first ones are the pose.
        others: Places of the n other vehicles at the same instants, shape (n, M + 1, 4); the first
            three numbers of each are its pose.
    """
    before = 0.0
    for i in range(len(x)):
        after, farthest, moved = np.inf, 0.0, 0.0
        for j in range(len(others)):
            x_o, y_o, yaw_o = others[j, i, 0], others[j, i, 1], others[j, i, 2]
            apart = _separation(x[i, 0], x[i, 1], x[i, 2], x_o, y_o, yaw_o)
            after = min(after, apart - _ROUNDING)
            if i > 0:
                dx, dy = x_o - others[j, i - 1, 0], y_o - others[j, i - 1, 1]
                turned = abs(yaw_o - others[j, i - 1, 2])
                farthest = max(farthest, math.hypot(dx, dy) + REACH * turned)
        if i > 0:
            dx, dy = x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1]
            moved = math.hypot(dx, dy) + REACH * abs(x[i, 2] - x[i - 1, 2]) + farthest
            if before + after <= BENT * moved:
                return False
        if after <= 0:
            return False
        before = after
    return True


@inner()
def _separation(x_a, y_a, yaw_a, x_b, y_b, yaw_b):  # type: ignore[no-untyped-def]
    """Return the separation of the bodies at two poses [m]."""
    turned = yaw_b - yaw_a
    c, s = abs(math.cos(turned)), abs(math.sin(turned))
    along = _LONG * (1 + c) + _BROAD * s  # half the sum of both projections, along a body
    across = _BROAD * (1 + c) + _LONG * s  # the same across it
    c_a, s_a, c_b, s_b = math.cos(yaw_a), math.sin(yaw_a), math.cos(yaw_b), math.sin(yaw_b)
    x = (x_b - _LONG * c_b) - (x_a - _LONG * c_a)  # from center to center
    y = (y_b - _LONG * s_b) - (y_a - _LONG * s_a)
    of_a = max(abs(x * c_a + y * s_a) - along, abs(y * c_a - x * s_a) - across)
    of_b = max(abs(x * c_b + y * s_b) - along, abs(y * c_b - x * s_b) - across)
    return max(of_a, of_b)


@inner()
def _outside(y, yaw, road):  # type: ignore[no-untyped-def]
    """Return how far the outermost corner of a body is off the road [m]."""
    right, left = road
    rear, half = y - LENGTH * math.sin(yaw), _BROAD * abs(math.cos(yaw))
    return max(max(y, rear) + half - left, right - (min(y, rear) - half))


@inner()
def _to_corners(a, b, i, nearest):  # type: ignore[no-untyped-def]
    """Return the distance from the body in row `i` of `a` to the nearest corner of that of `b`.

    If no corner is nearer than `nearest` [m], return that.
    """
    c, s = math.cos(a[i, 2]), math.sin(a[i, 2])
    forward, left = math.cos(b[i, 2]), math.sin(b[i, 2])
    for back in (0.0, -LENGTH):
        for side in (_BROAD, -_BROAD):
            x = b[i, 0] + back * forward + side * -left - a[i, 0]
            y = b[i, 1] + back * left + side * forward - a[i, 1]
            ahead = max(abs(c * x + s * y + _LONG) - _LONG, 0.0)
            aside = max(abs(c * y - s * x) - _BROAD, 0.0)
            if max(ahead, aside) < nearest:  # otherwise spare the root, which takes most time
                nearest = min(nearest, math.hypot(ahead, aside))
    return nearest


# --- The other vehicles, and the signals of an experiment that depend on them.

Signal = Float[np.ndarray, " K"]
Places = Float[np.ndarray, "K 4"]
"""Rows of x, y [m], heading [rad] and speed along the road [m/s]; the first three are the pose."""


class Mover(Protocol):
    """The motion of another vehicle."""

    def at(self, t: Times) -> Places:
        """Return pose and speed at the times `t` [s], shape (K, 4)."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A vehicle that drives straight ahead and ignores all others; the defaults are the paper's."""

    x: float = 30.0  # initial front end [m]
    y: float = 0.0  # center line, to the left [m]
    speed: float = OBSTACLE_SPEED  # speed [m/s]

    def at(self, t: Times) -> Places:
        """Return pose and speed at the times `t` [s], shape (K, 4)."""
        places = np.empty((len(t), 4))
        places[:, 0] = self.x + self.speed * t
        places[:, 1:] = self.y, 0.0, self.speed
        return places


def signals_of(
    t: Times, poses: Poses, phases: Signal, movers: Sequence[Mover], road: tuple[float, float] = ROAD
) -> dict[str, Signal]:
    """Return all signals by name, each of shape (K,).

    `obstacle_x`, `obstacle_y` [m], `obstacle_v` [m/s], and `obstacle2_x` ... for further ones;
    `obstacle_yaw` [rad] of one that turns: the angle of its body from the road's direction.
    `road_left` [m]: the left edge, if the road is not the paper's.
    `gap` [m]: x_o - 4.5 - x_f to the obstacle that is nearest along the road.
    `lateral_distance` [m]: the smallest to obstacles alongside; NaN if there are none.
    `separation` [m]: a lower bound on the distance of the bodies; below 1e-3 if they touched.
    `outside` [m]: how far the outermost corner is off the road, negative if inside.
    `phase`: 0 lane keeping, 1 overtaking, held from sampling instants on.
    `speed_reference`, `speed_low` [m/s]: reference and lower limit of v in that phase.
    `lateral_reference` [m]: reference of y_f; 0, or while overtaking 3 m left of the obstacle.
    """
    places = [mover.at(t) for mover in movers]
    others = [place[:, :3] for place in places]
    named: dict[str, Signal] = {}
    for i, place in enumerate(places, start=1):
        name = "obstacle" if i == 1 else f"obstacle{i}"
        named |= {f"{name}_x": place[:, 0], f"{name}_y": place[:, 1], f"{name}_v": place[:, 3]}
        if place[:, 2].any():
            named[f"{name}_yaw"] = place[:, 2]
    if road != ROAD:
        named["road_left"] = np.full(len(t), road[1])
    overtaking = phases == DrivePhase.OVERTAKING
    ahead = np.array([other[:, 0] for other in others]) - poses[:, 0]
    return named | {
        "gap": gap(0.0, ahead[np.abs(ahead).argmin(axis=0), np.arange(len(t))]),
        # NaN only if it is NaN to all.
        "lateral_distance": np.fmin.reduce([lateral_distance(poses, other) for other in others]),
        "separation": np.fmin.reduce([separation(poses, other) for other in others]),
        "outside": outside(poses, road),
        "phase": phases,
        "speed_reference": np.where(overtaking, OVERTAKING_SPEED, KEEPING_SPEED),
        "lateral_reference": _lateral_reference(poses[:, 0], others, overtaking),
        "speed_low": np.where(overtaking, OVERTAKING_SPEEDS[0], KEEPING_SPEEDS[0]),
    }


def _lateral_reference(x_f: Signal, others: list[Poses], overtaking: Bool[np.ndarray, " K"]) -> Signal:
    """Return the reference of y_f [m], shape (K,): 3 m beside the leftmost near obstacle, as tuned.

    Once no obstacle is near, the reference keeps its value until the overtaking ends.
    """
    line = np.full(len(x_f), -np.inf)
    for other in others:
        ahead, y_o = other[:, 0] - x_f, other[:, 1]  # [m], from the ego front end to the other's
        near = (gap(0.0, ahead) < SAFETY_DISTANCE) & (clearance(0.0, ahead) <= SAFETY_DISTANCE)
        line = np.where(near & (y_o < LANE_WIDTH / 2), np.maximum(line, y_o), line)
    known = np.maximum.accumulate(np.where(np.isfinite(line), np.arange(len(line)), -1))
    held = np.where(known >= 0, line[known], 0.0)
    return np.where(overtaking, held + MIN_LATERAL_DISTANCE, 0.0)
