"""Bodies on the road: rectangles of 4.5 x 1.8 m, each a pose (x, y [m], heading [rad]).

A pose is that of the front end on the center line, so the body's center is 2.25 m behind it.
Headings are counterclockwise from the road's direction; y is to the left. Loads the compiler.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from . import _kernels
from .rules import LENGTH, ROAD, WIDTH

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
    return np.asarray(_kernels.separation(_plain(a), _plain(b)))


def distance(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return the distance of the outlines of the bodies at `a` and `b` [m], shape (K,).

    It is always at a corner of one of them, and 0 if a corner of one is in the other.
    """
    return np.asarray(_kernels.distance(_plain(a), _plain(b)))


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
    return np.asarray(_kernels.outside(_plain(poses), road))


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
