"""Compiled checks of one sampling period: does the ego vehicle stay on the road, and apart?

In numpy they take 20 times as long, because most periods have a few instants only. numba keeps the
compiled code beside this file and checks only this file to see whether it is stale: after a change
of a constant imported here, touch it.
"""

import math

import numpy as np

from prefcal_env.jit import inner, kernel

from .contact import BENT, CONTACT
from .geometry import REACH
from .rules import LENGTH, WIDTH

_BROAD = WIDTH / 2


@kernel()
def kept(x, road, margin):  # type: ignore[no-untyped-def]
    """Return how many instants after the first to keep, and why not all of them.

    Args:
        x: States at the M + 1 instants, shape (M + 1, n_x); the first ones are the pose.
        road: Right and left edge of the road, y [m].
        margin: Distance off the road at which a body has left it [m].

    Returns:
        The number of instants, and 0 for all, 1 if the next state is not finite, or 2 if the last
        one of them is off the road.
    """
    right, left = road
    for i in range(1, len(x)):
        for k in range(x.shape[1]):
            if not math.isfinite(x[i, k]):
                return i - 1, 1
        _, _, low, high = _box(x[i, 0], x[i, 1], x[i, 2])
        if max(high - left, right - low) > margin:
            return i, 2
    return len(x) - 1, 0


@kernel()
def surely_apart(x, others):  # type: ignore[no-untyped-def]
    """Return whether `first_contact` finds no contact, by a bound that is quick to compute.

    The boxes around two bodies along the road are as far apart as `separation` says, or farther
    apart on neither axis, if the other vehicle is straight. Of turned ones nothing is known here.
    `CONTACT` is far above rounding errors.

    Args:
        x: States at the M + 1 instants, shape (M + 1, n_x); the first ones are the pose.
        others: Poses of the n other vehicles at the same instants, shape (n, M + 1, 3).
    """
    before = _distance(x, others, 0) - CONTACT
    for i in range(1, len(x)):
        after = _distance(x, others, i) - CONTACT
        moved = math.hypot(x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1])
        moved += REACH * abs(x[i, 2] - x[i - 1, 2])
        farthest = 0.0
        for j in range(len(others)):
            dx, dy = others[j, i, 0] - others[j, i - 1, 0], others[j, i, 1] - others[j, i - 1, 1]
            farthest = max(farthest, math.hypot(dx, dy))
        if not (before > 0 and after > 0 and before + after > BENT * (moved + farthest)):
            return False
        before = after
    return True


@inner()
def _distance(x, others, i):  # type: ignore[no-untyped-def]
    """Return a lower bound on the distance to the nearest vehicle at instant `i` [m]."""
    rear, front, right, left = _box(x[i, 0], x[i, 1], x[i, 2])
    nearest = np.inf
    for j in range(len(others)):
        if others[j, i, 2] != 0:
            return 0.0
        x_o, y_o = others[j, i, 0], others[j, i, 1]
        along = max(rear - x_o, x_o - LENGTH - front)
        across = max(right - (y_o + _BROAD), y_o - _BROAD - left)
        nearest = min(nearest, max(along, across))
    return nearest


@inner()
def _box(x, y, yaw):  # type: ignore[no-untyped-def]
    """Return the smallest and largest x, and the smallest and largest y, of a body [m]."""
    c, s = math.cos(yaw), math.sin(yaw)
    rear_x, rear_y = x - LENGTH * c, y - LENGTH * s
    half_x, half_y = _BROAD * abs(s), _BROAD * abs(c)
    return (
        min(x, rear_x) - half_x, max(x, rear_x) + half_x,
        min(y, rear_y) - half_y, max(y, rear_y) + half_y,
    )  # fmt: skip
