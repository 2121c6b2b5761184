"""The compiled check after a solve; in numpy it costs as much as the solve itself.

It loops over numbers only: whole-array expressions take several times as long to compile.
"""

import numpy as np

from prefcal_env.jit import kernel

TOLERANCE = 1e-6
"""Share of its scale by which a residual of a solution may differ from 0."""


@kernel()
def residuals(P, q, G, lower, upper, z, y):  # type: ignore[no-untyped-def]
    """Return feasibility, stationarity and duality gap of (z, y), each followed by its scale.

    That is (largest row violation, its scale, |Pz + q + Gᵀy|∞, its scale,
    |zᵀPz + qᵀz + yᵀb|, its scale), where b is the bound that y pushes against and a scale is the
    size of the terms.
    """
    n, m = len(q), len(lower)
    curvature, slope, push = 0.0, 0.0, 0.0
    violation, reach = 0.0, 0.0
    gradient, force = np.empty(n), np.empty(n)
    for i in range(n):
        gradient[i], force[i] = q[i], abs(q[i])
    for i in range(m):
        row = 0.0
        for j in range(n):
            row += G[i, j] * z[j]
            pull = G[i, j] * y[i]
            gradient[j] += pull
            force[j] = max(force[j], abs(pull))
        violation = max(violation, row - upper[i], lower[i] - row)
        reach = max(reach, abs(row))
        if y[i] > 0.0:
            push += y[i] * upper[i]
        elif y[i] < 0.0:
            push += y[i] * lower[i]
    for i in range(n):
        Pz = 0.0
        for j in range(n):
            Pz += P[i, j] * z[j]
        gradient[i] += Pz
        force[i] = max(force[i], abs(Pz))
        curvature += z[i] * Pz
        slope += q[i] * z[i]
    steepest, strongest = 0.0, 0.0
    for i in range(n):
        slope_i = abs(gradient[i])
        # Not max(): NaN must be passed on, so that a solution with NaN never counts as solved.
        if slope_i > steepest or np.isnan(slope_i):
            steepest = slope_i
        if force[i] > strongest or np.isnan(force[i]):
            strongest = force[i]
    return (
        violation,
        1.0 + reach,
        steepest,
        1.0 + strongest,
        abs(curvature + slope + push),
        1.0 + abs(curvature) + abs(slope) + abs(push),
    )
