"""The prediction model of one MPC step, compiled: eq. mathcalS linearized and discretized.

x⁺ = A[k] x + B[k] u + c[k] and y_k = C[k] x + D[k] u + e[k], with x and u relative to the present
state and the last input, and y absolute. k runs from 0 to N_p - 1 for the states and from 0 to N_p
for the outputs. An array with one entry is used for all k; e always has N_p + 1 rows.
"""

import numpy as np

from prefcal_env.jit import inlined, inner, kernel
from prefcal_env.plants._calls import call

from .hold import discretize


@inlined()
def at_point(equations, x, u, d, T_s, N_p, n_y):  # type: ignore[no-untyped-def]
    """Return one model for the whole horizon, exact at (x, u): it keeps the term f(x, u, d).

    If d is a preview (rows for the coming steps, the last one is repeated), the affine terms
    follow each row; the Jacobians are those of the present.
    """
    n_x = len(x)
    C, D = np.empty((1, n_y, n_x)), np.empty((1, n_y, len(u)))
    A_c, B_c = jacobians(equations, x, u, d[0], C[0], D[0])
    steps = min(len(d), N_p)
    A, B = np.empty((1, n_x, n_x)), np.empty((1, n_x, len(u)))
    c, e = np.empty((steps, n_x)), np.empty((N_p + 1, n_y))
    f = np.empty(n_x)
    for k in range(steps):
        _f(equations, x, u, d[k], f)
        A_d, B_d, c_d = discretize(A_c, B_c, f, T_s)
        _copy(A_d, A[0])
        _copy(B_d, B[0])
        for i in range(n_x):
            c[k, i] = c_d[i]
    for k in range(N_p + 1):
        if k < len(d):
            outputs(equations, x, u, d[k], e[k])
        else:
            for i in range(n_y):
                e[k, i] = e[k - 1, i]
    return A, B, c, C, D, e


@kernel()
def along_trajectory(equations, x, u, d, X, V, T_s, n_y):  # type: ignore[no-untyped-def]
    """Return the model of eq. MPCsys around the nominal states X (N_p + 1) and inputs V (N_p)."""
    N_p, n_x, n_u = len(V), len(x), len(u)
    A, B, c = np.empty((N_p, n_x, n_x)), np.empty((N_p, n_x, n_u)), np.empty((N_p, n_x))
    C, D = np.empty((N_p + 1, n_y, n_x)), np.empty((N_p + 1, n_y, n_u))
    e, still = np.empty((N_p + 1, n_y)), np.zeros(n_x)
    for k in range(N_p + 1):
        v, d_k = V[min(k, N_p - 1)], d[min(k, len(d) - 1)]
        A_c, B_c = jacobians(equations, X[k], v, d_k, C[k], D[k])
        outputs(equations, X[k], v, d_k, e[k])
        _shift(e[k], C[k], X[k], x)
        _shift(e[k], D[k], v, u)
        if k < N_p:
            A_d, B_d, _ = discretize(A_c, B_c, still, T_s)
            _copy(A_d, A[k])
            _copy(B_d, B[k])
            # x_{k+1} - x = A (x_k - x) + B (v - u) + c passes through the nominal points.
            for i in range(n_x):
                c[k, i] = X[k + 1, i] - x[i]
            _shift(c[k], A[k], X[k], x)
            _shift(c[k], B[k], v, u)
    return A, B, c, C, D, e


@inner()
def _shift(out, M, point, origin):  # type: ignore[no-untyped-def]
    """Compute out -= M (point - origin), in place."""
    for i in range(len(out)):
        for j in range(len(point)):
            out[i] -= M[i, j] * (point[j] - origin[j])


@inner()
def _copy(source, target):  # type: ignore[no-untyped-def]
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@inner()
def _inputs(equations, u, d):  # type: ignore[no-untyped-def]
    """Return the inputs with the disturbances that act on them (see `Equations.on_inputs`)."""
    on_inputs, v = equations[5], u.copy()
    first = len(d) - len(on_inputs)
    for j in range(len(on_inputs)):
        v[on_inputs[j]] += d[first + j]
    return v


@inlined()
def _f(equations, x, u, d, out):  # type: ignore[no-untyped-def]
    """Write ẋ."""
    call(equations[0], x, _inputs(equations, u, d), d, equations[3], out)


@inner()
def outputs(equations, x, u, d, out):  # type: ignore[no-untyped-def]
    """Write y, with the disturbances that are added to it (see `Equations.on_outputs`)."""
    on_outputs = equations[4]
    if equations[1] != 0:
        call(equations[1], x, _inputs(equations, u, d), d, equations[3], out)
    else:
        for i in range(len(out)):
            out[i] = x[i]
    first = len(d) - len(equations[5]) - len(on_outputs)
    for j in range(len(on_outputs)):
        out[on_outputs[j]] += d[first + j]


@inner()
def jacobians(equations, x, u, d, C, D):  # type: ignore[no-untyped-def]
    """Return A and B, and write C and D."""
    n_x, n_u, n_y = len(x), len(u), len(C)
    A, B = np.empty((n_x, n_x)), np.empty((n_x, n_u))
    packed = np.empty((n_x + n_y) * (n_x + n_u))
    call(equations[2], x, _inputs(equations, u, d), d, equations[3], packed)
    at = _unpack(packed, 0, A)
    at = _unpack(packed, at, B)
    at = _unpack(packed, at, C)
    _unpack(packed, at, D)
    return A, B


@inner()
def _unpack(packed, at, matrix):  # type: ignore[no-untyped-def]
    """Fill `matrix` with the numbers from `at` on, and return where the next one begins."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = packed[at]
            at += 1
    return at
