"""Compiled equations of the CSTR; p are its parameters, in the order of `CSTRParams`."""

import math

from ._calls import equation


@equation()
def f(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ of eq. cstr_system_eqn."""
    r = p[1] * math.exp(-p[3] / (p[6] * x[0])) * x[1] if x[0] > 0 else 0.0
    out[0] = p[0] * (d[0] - x[0]) + p[2] / p[4] * r - p[5] / p[4] * (x[0] - u[0])
    out[1] = p[0] * (d[1] - x[1]) - r


@equation()
def jacobians(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write A, B, C = 1 and D = 0."""
    k = p[1] * math.exp(-p[3] / (p[6] * x[0])) if x[0] > 0 else 0.0
    slope = k * x[1] * p[3] / (p[6] * x[0] ** 2)
    heat, cooling = p[2] / p[4], p[5] / p[4]
    out[0], out[1] = -p[0] + heat * slope - cooling, heat * k
    out[2], out[3] = -slope, -p[0] - k
    out[4], out[5] = cooling, 0.0
    out[6], out[7], out[8], out[9] = 1.0, 0.0, 0.0, 1.0
    out[10], out[11] = 0.0, 0.0
