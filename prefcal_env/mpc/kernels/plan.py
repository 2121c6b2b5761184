"""The plan of one MPC step, compiled: inputs and states as affine functions of the variables.

The code loops over numbers, uses no slices, and each argument has one type: the user waits while
all of this compiles (see `prefcal_env.compiling`).
"""

import numpy as np

from prefcal_env.jit import inlined, inner

_LARGEST_WEIGHT_RATIO = 1e4


@inner()
def _add(row, factor, other):  # type: ignore[no-untyped-def]
    """Compute row += factor other, in place."""
    for q in range(len(row)):
        row[q] += factor * other[q]


@inner()
def _step(A, B, c, k, X, W):  # type: ignore[no-untyped-def]
    """Compute X[k + 1] = A X[k] + B W + c, affine in the variables (last column: constant)."""
    i = min(k, A.shape[0] - 1)
    n_x, n_u = B.shape[1], B.shape[2]
    for a in range(n_x):
        for q in range(n_x):
            _add(X[k + 1, a], A[i, a, q], X[k, q])
        for q in range(n_u):
            _add(X[k + 1, a], B[i, a, q], W[q])
        X[k + 1, a, X.shape[2] - 1] += c[min(k, c.shape[0] - 1), a]


@inlined()
def forward(A, B, c, R, N_y):  # type: ignore[no-untyped-def]
    """Return inputs and states as affine functions of the deviations v (last column: constant).

    Starts from x = 0 and w = 0. Returns U (N_u, n_u, n_v + 1), X (N_y + 1, n_x, n_v + 1), where N_y
    is the number of steps to predict (after N_u the last input is held), and the unit of v: the
    smallest of the weights. With this unit v moves an input by about its own size, and a solver's
    tolerance on v means about the same for the inputs.

    If the weight of a deviation is far above the others of the same input, no later input can
    correct that deviation (the growing mode, once the input is held). Its weight is cut to 1e4
    times theirs: the exact weight would put it at zero, or at the nearest reachable value, to 20
    digits; this one does so to 8 digits.
    """
    N_u, n_u = R.shape[0], R.shape[1]
    n_x = A.shape[1]
    n_v = N_u * n_u
    U = np.zeros((N_u, n_u, n_v + 1))
    X = np.zeros((max(N_u, N_y) + 1, n_x, n_v + 1))
    W = np.zeros((n_u, n_v + 1))
    smallest = np.empty(n_u)
    unit = np.inf
    for j in range(n_u):
        smallest[j] = np.inf
        for k in range(N_u):
            smallest[j] = min(smallest[j], abs(R[k, j, j]))
        unit = min(unit, smallest[j])
    for k in range(max(N_u, N_y)):
        if k < N_u:
            for j in range(n_u - 1, -1, -1):  # back substitution
                inverse = 1.0 / R[k, j, j]
                row = U[k, j]
                for q in range(n_x):
                    _add(row, -(R[k, j, n_u + q] * inverse), X[k, q])
                for q in range(n_u):
                    _add(row, -(R[k, j, n_u + n_x + q] * inverse), W[q])
                for q in range(j + 1, n_u):
                    _add(row, -(R[k, j, q] * inverse), U[k, q])
                row[n_v] -= R[k, j, n_u + n_x + n_u] * inverse
                weight = min(abs(R[k, j, j]), _LARGEST_WEIGHT_RATIO * smallest[j])
                row[k * n_u + j] += unit / weight
            for j in range(n_u):
                for q in range(n_v + 1):
                    W[j, q] = U[k, j, q]
        _step(A, B, c, k, X, W)
    return U, X, unit
