"""Bodies on the road: rectangles of 4.5 x 1.8 m, each a pose (x, y [m], heading [rad]).

A pose is that of the front end on the center line, so the body's center is 2.25 m behind it.
Headings are counterclockwise from the road's direction; y is to the left.

What a period asks for at each instant is compiled: in numpy a period, which has a few instants only,
takes 20 times as long.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.jit import inner, kernel

from .rules import LENGTH, ROAD, WIDTH

_LONG, _BROAD = LENGTH / 2, WIDTH / 2
_ROUNDING = 1e-9
"""Distance far above rounding errors and far below any that matters [m]."""

REACH = float(np.hypot(LENGTH, WIDTH / 2))
"""Distance from the front end to the farthest point of the body [m]."""
CONTACT = 1e-3
"""Distance below which bodies have touched [m]."""
BENT = 1.1
"""Factor by which a path between two close instants may be longer than its chord."""

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


def overlap(a: Poses, b: Poses) -> Bool[np.ndarray, " K"]:
    """Return whether the bodies at `a` and `b` touch, exactly, shape (K,)."""
    return np.asarray(separation(a, b) <= 0)


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
    """Return whether `geometry.first_contact` rules out a contact at first sight.

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
