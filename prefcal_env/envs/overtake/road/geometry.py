"""Bodies on the road: rectangles of 4.5 x 1.8 m, each a pose (x, y [m], heading [rad]).

A pose is that of the front end on the center line, so the body's center is 2.25 m behind it.
Headings are counterclockwise from the road's direction; y is to the left.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .rules import LENGTH, ROAD, WIDTH

REACH = float(np.hypot(LENGTH, WIDTH / 2))
"""Distance from the front end to the farthest point of the body [m]."""
_BROAD = WIDTH / 2

Poses = Float[np.ndarray, "K 3"]


def separation(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return a lower bound on the distance of the bodies at `a` and `b` [m], shape (K,).

    At most 0 means that they touch. This is the largest gap between their projections on the four
    directions of their sides: never more than their distance, and positive exactly when they are
    disjoint (separating axes).
    """
    return np.asarray(_compiled().separation(_plain(a), _plain(b)))


def distance(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return the distance of the outlines of the bodies at `a` and `b` [m], shape (K,).

    It is always at a corner of one of them, and 0 if a corner of one is in the other.
    """
    return np.asarray(_compiled().distance(_plain(a), _plain(b)))


def overlap(a: Poses, b: Poses) -> Bool[np.ndarray, " K"]:
    """Return whether the bodies at `a` and `b` touch, exactly, shape (K,)."""
    return np.asarray(separation(a, b) <= 0)


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
    return np.asarray(_compiled().outside(_plain(poses), road))


def lateral_distance(a: Poses, b: Poses) -> Float[np.ndarray, " K"]:
    """Return the distance between the center lines of bodies alongside each other [m], (K,).

    This is abs(y_f - y_o) if abs(x_f - x_o) < 4.5 m, and NaN otherwise.
    """
    alongside = np.abs(a[:, 0] - b[:, 0]) < LENGTH
    return np.where(alongside, np.abs(a[:, 1] - b[:, 1]), np.nan)


def _plain(poses: Poses) -> Poses:
    """Return a copy: for read-only or strided arrays, kernels would be compiled again."""
    return np.array(poses, dtype=float, order="C")


def _compiled() -> Any:
    # Imported here so that importing the package does not load the compiler.
    from . import _kernels

    return _kernels
