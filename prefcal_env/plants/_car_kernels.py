"""The exact hold of the bicycle, compiled.

In numpy the hold takes five times as long, because most periods have a few instants only.
"""

import math

import numpy as np

from prefcal_env.jit import kernel

_SMALLEST = np.finfo(float).eps


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
