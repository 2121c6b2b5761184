"""Compiled equations of the bicycle, and its exact hold.

In numpy the hold takes five times as long, because most periods have a few instants only.
"""

import math

import numpy as np

from prefcal_env.jit import kernel

from ._calls import equation

_SMALLEST = np.finfo(float).eps


@equation()
def bicycle(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ of eq. nonlin_bicyclemodel; p is the length L."""
    heading = x[2] + u[1]
    out[0], out[1] = u[0] * math.cos(heading), u[0] * math.sin(heading)
    out[2] = u[0] * math.sin(u[1]) / p[0]


@equation()
def bicycle_jacobians(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write A, B, C = 1 and D = 0."""
    v, c, s = u[0], math.cos(x[2] + u[1]), math.sin(x[2] + u[1])
    for i in range(30):
        out[i] = 0.0
    out[2], out[5] = -v * s, v * c
    out[9], out[10] = c, -v * s
    out[11], out[12] = s, v * c
    out[13], out[14] = math.sin(u[1]) / p[0], v * math.cos(u[1]) / p[0]
    out[15], out[19], out[23] = 1.0, 1.0, 1.0


@kernel()
def hold_bicycle(x_f, y_f, yaw, v, steering, length, times):  # type: ignore[no-untyped-def]
    """Return the states at `times` [s], shape (K, 3); see `Bicycle.hold`."""
    states = np.empty((len(times), 3))
    rate = v * math.sin(steering) / length  # rad/s
    for i in range(len(times)):
        turned = rate * times[i]
        half = math.pi * (turned / (2 * math.pi))  # rounded like the argument of numpy's sinc
        if half == 0:
            half = _SMALLEST
        chord = v * times[i] * (math.sin(half) / half)
        direction = yaw + steering + turned / 2
        states[i, 0] = x_f + chord * math.cos(direction)
        states[i, 1] = y_f + chord * math.sin(direction)
        states[i, 2] = yaw + turned
    return states
