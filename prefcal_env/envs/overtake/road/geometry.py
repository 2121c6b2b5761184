"""Bodies on the road: rectangles of 4.5 x 1.8 m, each a pose (x, y [m], heading [rad]).

A pose is that of the front end on the center line, so the body's center is 2.25 m behind it.
Headings are counterclockwise from the road's direction; y is to the left.
"""

import numpy as np
from jaxtyping import Bool, Float

from .rules import LENGTH, ROAD, WIDTH

REACH = float(np.hypot(LENGTH, WIDTH / 2))
"""Distance from the front end to the farthest point of the body [m]."""
_LONG, _BROAD = LENGTH / 2, WIDTH / 2

Poses = Float[np.ndarray, "K 3"]


def separation(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return a lower bound on the distance of the bodies at `a` and `b` [m], shape (K,).

    At most 0 means that they touch. This is the largest gap between their projections on the four
    directions of their sides: never more than their distance, and positive exactly when they are
    disjoint (separating axes).
    """
    turned = b[:, 2] - a[:, 2]
    c, s = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    along = _LONG * (1 + c) + _BROAD * s  # half the sum of both projections, along a body
    across = _BROAD * (1 + c) + _LONG * s  # the same across it
    headings = [(np.cos(pose[:, 2]), np.sin(pose[:, 2])) for pose in (a, b)]
    (forward_a, left_a), (forward_b, left_b) = headings
    x = (b[:, 0] - _LONG * forward_b) - (a[:, 0] - _LONG * forward_a)  # from center to center
    y = (b[:, 1] - _LONG * left_b) - (a[:, 1] - _LONG * left_a)
    gaps = []
    for forward, left in headings:
        ahead = np.abs(x * forward + y * left)
        aside = np.abs(y * forward - x * left)
        gaps += [ahead - along, aside - across]
    smallest: Float[np.ndarray, " K"] = np.max(gaps, axis=0)
    return smallest


def overlap(a: Poses, b: Poses) -> Bool[np.ndarray, " K"]:
    """Return whether the bodies at `a` and `b` touch, exactly, shape (K,)."""
    return np.asarray(separation(a, b) <= 0)


def centers(poses: Poses) -> Float[np.ndarray, "K 2"]:
    """Return the centers of the bodies, (x, y) [m], shape (K, 2)."""
    heading = poses[:, 2]
    return poses[:, :2] - _LONG * np.stack([np.cos(heading), np.sin(heading)], axis=1)


def corners(poses: Poses) -> Float[np.ndarray, "K 4 2"]:
    """Return the corners (x, y) [m]: front left, rear left, rear right, front right."""
    forward = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    sides = [(0, _BROAD), (-LENGTH, _BROAD), (-LENGTH, -_BROAD), (0, -_BROAD)]
    return np.stack([poses[:, :2] + a * forward + b * left for a, b in sides], axis=1)


def outside(poses: Poses, road: tuple[float, float] = ROAD) -> Float[np.ndarray, " K"]:
    """Return how far the outermost corner is off the road [m], shape (K,); negative if inside.

    `road` is the right and the left edge of the road, y [m].
    """
    front, rear = poses[:, 1], poses[:, 1] - LENGTH * np.sin(poses[:, 2])
    half = _BROAD * np.abs(np.cos(poses[:, 2]))
    leftmost, rightmost = np.maximum(front, rear) + half, np.minimum(front, rear) - half
    right_edge, left_edge = road
    return np.asarray(np.maximum(leftmost - left_edge, right_edge - rightmost))


def lateral_distance(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return the distance between the center lines of bodies alongside each other [m], (K,).

    This is abs(y_f - y_o) if abs(x_f - x_o) < 4.5 m, and NaN otherwise.
    """
    alongside = np.abs(a[:, 0] - b[:, 0]) < LENGTH
    return np.where(alongside, np.abs(a[:, 1] - b[:, 1]), np.nan)
