"""Compiled geometry of bodies on the road, and what can end a sampling period early.

In numpy a period takes 20 times as long, because it has a few instants only.
"""

import math

import numpy as np

from prefcal_env.jit import inner, kernel

from .rules import LENGTH, WIDTH

_LONG, _BROAD = LENGTH / 2, WIDTH / 2
_ROUNDING = 1e-9
"""Distance far above rounding errors and far below any that matters [m]."""


@kernel()
def separation(a, b):  # type: ignore[no-untyped-def]
    """Return `geometry.separation`, shape (K,), of poses of shape (K, 3)."""
    apart = np.empty(len(a))
    for i in range(len(a)):
        apart[i] = _separation(a[i, 0], a[i, 1], a[i, 2], b[i, 0], b[i, 1], b[i, 2])
    return apart


@kernel()
def distance(a, b):  # type: ignore[no-untyped-def]
    """Return `geometry.distance`, shape (K,), of poses of shape (K, 3)."""
    apart = np.empty(len(a))
    for i in range(len(a)):
        apart[i] = _to_corners(b, a, i, _to_corners(a, b, i, np.inf))
    return apart


@kernel()
def outside(poses, road):  # type: ignore[no-untyped-def]
    """Return `geometry.outside`, shape (K,), of poses of shape (K, 3)."""
    off = np.empty(len(poses))
    for i in range(len(poses)):
        off[i] = _outside(poses[i, 1], poses[i, 2], road)
    return off


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
    for i in range(1, len(x)):
        for k in range(x.shape[1]):
            if not math.isfinite(x[i, k]):
                return i - 1, 1
        if _outside(x[i, 1], x[i, 2], road) > margin:
            return i, 2
    return len(x) - 1, 0


@kernel()
def surely_apart(x, others, bent, reach):  # type: ignore[no-untyped-def]
    """Return whether `geometry.first_contact` rules out a contact at first sight.

    Args:
        x: States at the M + 1 instants, shape (M + 1, n_x); the first ones are the pose.
        others: Places of the n other vehicles at the same instants, shape (n, M + 1, 4); the first
            three numbers of each are its pose.
        bent: Factor by which a path may be longer than its chord.
        reach: Distance from the front end to the farthest point of a body [m].
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
                farthest = max(farthest, math.hypot(dx, dy) + reach * turned)
        if i > 0:
            dx, dy = x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1]
            moved = math.hypot(dx, dy) + reach * abs(x[i, 2] - x[i - 1, 2]) + farthest
            if before + after <= bent * moved:
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
