"""Compiled fixed-step simulation of a closed loop: dead time, noise, disturbance, saturation."""

import math

import numpy as np

from prefcal_env.jit import inner, kernel

from ._laws import MEMORY, decide, moved, rounded
from .right_hand_sides import derivative


@kernel()
def simulate(plant, control, signals, timing, start):  # type: ignore[no-untyped-def]
    """Simulate K instants and return x (K, n_x), u (K, n_u) and how many instants are valid.

    The simulation stops after the first state that is outside its limits or not finite; a state
    that is not finite is not valid.

    Args:
        plant: Kind, parameters, and indices of the measured states (n_m,).
        control: Kind of law, its gains (rows, columns), the actuators (0 or n_u, 4), see
            `_laws.moved`, and the resolution of the measured states (0 or n_m,).
        signals: Reference (K, n_m), disturbance (K, n_d) and measurement noise (K, n_m).
        timing: Step, steps in a sampling period, and steps of dead time of the inputs.
        start: State (n_x,) and inputs (n_u,) at the start, and limits of the states (n_x, 2).
    """
    kind, p, measured = plant
    law, gains, actuators, resolution = control
    reference, disturbance, noise = signals
    dt, hold, delay = timing
    x0, u0, limits = start
    count, n_x = len(reference), len(x0)
    x, u = np.zeros((count, n_x)), np.zeros((count, len(u0)))
    memory, y = np.zeros((len(gains), MEMORY)), np.zeros(len(measured))
    work = np.zeros((5, n_x))
    _copy(x0, x[0])
    for k in range(count):
        if k % hold == 0:
            for i in range(len(measured)):
                y[i] = x[k, measured[i]] + noise[k, i]
            for i in range(len(resolution)):
                y[i] = rounded(y[i], resolution[i])
            decide(law, gains, reference[k], y, memory, hold * dt, u[k])
            for j in range(len(actuators)):
                u[k, j] = moved(actuators, j, u[k, j], u[k - 1, j] if k > 0 else u0[j])
        else:
            _copy(u[k - 1], u[k])
        if k + 1 < count:
            applied = u[k - delay] if k >= delay else u0
            _step(kind, p, x[k], applied, disturbance[k], dt, work, x[k + 1])
            inside, finite = _within(x[k + 1], limits)
            if not inside:
                if finite:
                    _copy(u[k], u[k + 1])
                return x, u, k + 2 if finite else k + 1
    return x, u, count


@inner()
def _copy(source, target):  # type: ignore[no-untyped-def]
    """Copy a vector: assigning to a slice would take seconds to compile."""
    for i in range(len(source)):
        target[i] = source[i]


@inner()
def _step(kind, p, x, u, d, dt, work, out):  # type: ignore[no-untyped-def]
    """Write the state after one Runge-Kutta step of order 4 to `out`."""
    k1, k2, k3, k4, between = work[0], work[1], work[2], work[3], work[4]
    derivative(kind, p, x, u, d, k1)
    for i in range(len(x)):
        between[i] = x[i] + dt / 2 * k1[i]
    derivative(kind, p, between, u, d, k2)
    for i in range(len(x)):
        between[i] = x[i] + dt / 2 * k2[i]
    derivative(kind, p, between, u, d, k3)
    for i in range(len(x)):
        between[i] = x[i] + dt * k3[i]
    derivative(kind, p, between, u, d, k4)
    for i in range(len(x)):
        out[i] = x[i] + dt / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i])


@inner()
def _within(x, limits):  # type: ignore[no-untyped-def]
    """Return whether the state is within its limits, and whether it is finite."""
    inside, finite = True, True
    for i in range(len(x)):
        if not math.isfinite(x[i]):
            finite = False
        if not (limits[i, 0] <= x[i] <= limits[i, 1]):
            inside = False
    return inside, finite


@kernel()
def advance(plant, dt, delay, at, history, limits):  # type: ignore[no-untyped-def]
    """Simulate one sampling period, writing to `x`.

    Return how many instants are valid, and whether the simulation stops there.

    Args:
        plant: Kind and parameters.
        dt: Step.
        delay: Steps of dead time of the inputs.
        at: First instant of the period and of the next one.
        history: States (K, n_x), inputs (K, n_u), written up to the end of the period, inputs
            before the start (n_u,), and disturbances (K, n_d).
        limits: Limits of the states (n_x, 2).
    """
    kind, p = plant
    first, last = at
    x, u, u0, disturbance = history
    work = np.zeros((5, x.shape[1]))
    for k in range(first, last):
        applied = u[k - delay] if k >= delay else u0
        _step(kind, p, x[k], applied, disturbance[k], dt, work, x[k + 1])
        inside, finite = _within(x[k + 1], limits)
        if not inside:
            return k + 2 if finite else k + 1, True
    return last + 1, False


@kernel()
def hold(kind, p, x, u, d, times, dt):  # type: ignore[no-untyped-def]
    """Return the states at `times`, shape (K, n_x), by steps of at most `dt`."""
    out = np.zeros((len(times), len(x)))
    work, now, after = np.zeros((5, len(x))), x.copy(), x.copy()
    t = 0.0
    for k in range(len(times)):
        count = max(math.ceil((times[k] - t) / dt - 1e-9), 1)
        for _ in range(count):
            _step(kind, p, now, u, d, (times[k] - t) / count, work, after)
            _copy(after, now)
        t = times[k]
        _copy(now, out[k])
    return out


@kernel()
def slopes(kind, p, x, u, d):  # type: ignore[no-untyped-def]
    """Return A = ∂ẋ/∂x and B = ∂ẋ/∂u by central differences."""
    n, m = len(x), len(u)
    A, B, work = np.zeros((n, n)), np.zeros((n, m)), np.zeros((2, n))
    for j in range(n):
        _slope(kind, p, x, u, d, (x, j), work, A)
    for j in range(m):
        _slope(kind, p, x, u, d, (u, j), work, B)
    return A, B


@inner()
def _slope(kind, p, x, u, d, place, work, out):  # type: ignore[no-untyped-def]
    """Write ∂ẋ over the number at `place`, in x or u, to its column of `out`."""
    vector, j = place
    here = vector[j]
    h = 1e-6 * max(abs(here), 1.0)
    vector[j] = here + h
    derivative(kind, p, x, u, d, work[0])
    vector[j] = here - h
    derivative(kind, p, x, u, d, work[1])
    vector[j] = here
    for i in range(len(x)):
        out[i, j] = (work[0, i] - work[1, i]) / (2 * h)


@kernel()
def rhs(kind, p, x, u, d):  # type: ignore[no-untyped-def]
    """Return ẋ of the plant `kind` with parameters `p`, shape (n_x,)."""
    dx = np.zeros(len(x))
    derivative(kind, p, x, u, d, dx)
    return dx
