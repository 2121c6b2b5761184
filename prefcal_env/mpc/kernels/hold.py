"""The exact zero-order hold of an affine model, compiled.

The code loops over numbers and uses no slices: a single assignment to a slice takes 4 s to compile,
while the user waits (see `prefcal_env.compiling`).
"""

import numpy as np

from prefcal_env.jit import inlined, inner, kernel

_TAYLOR_ORDER = 14
_SMALLEST_SCALED_NORM = 0.25


@kernel()
def discretize(A, B, c, T):  # type: ignore[no-untyped-def]
    """Return A_d, B_d and c_d of the exact zero-order hold of ẋ = A x + B u + c over T.

    x⁺ = A_d x + B_d u + c_d. Computes the exponential of [[A, B, c], [0, 0, 0]] T by scaling and
    squaring of its Taylor series.
    """
    n, m = B.shape
    size = n + m + 1
    M = np.zeros((size, size))
    norm = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            M[i, j] = A[i, j] * T
            total += abs(M[i, j])
        for j in range(m):
            M[i, n + j] = B[i, j] * T
        M[i, size - 1] = c[i] * T
        norm = max(norm, total)
    if not np.isfinite(norm):
        norm = 0.0  # the result is not finite either
    squarings = 0
    scale = 1.0
    while norm > _SMALLEST_SCALED_NORM:
        norm /= 2
        squarings += 1
        scale *= 2.0
    E = np.zeros((size, size))
    for i in range(size):
        E[i, i] = 1.0
        for j in range(size):
            M[i, j] /= scale
    # Horner's scheme: I + M (I + M/2 (I + M/3 ...)).
    for k in range(_TAYLOR_ORDER, 0, -1):
        E = multiply(M, E)
        for i in range(size):
            for j in range(size):
                E[i, j] = E[i, j] / k + (1.0 if i == j else 0.0)
    for _ in range(squarings):
        E = multiply(E, E)
    return _parts(E, n, m)


@inlined()
def _parts(E, n, m):  # type: ignore[no-untyped-def]
    """Return A_d, B_d and c_d, the blocks of the exponential."""
    A, B, c = np.empty((n, n)), np.empty((n, m)), np.empty(n)
    for i in range(n):
        for j in range(n):
            A[i, j] = E[i, j]
        for j in range(m):
            B[i, j] = E[i, n + j]
        c[i] = E[i, n + m]
    return A, B, c


@inner()
def multiply(X, Y):  # type: ignore[no-untyped-def]
    """Return X Y: loops are faster than a BLAS call at these sizes (4 x 4)."""
    out = np.zeros((X.shape[0], Y.shape[1]))
    for i in range(X.shape[0]):
        for k in range(X.shape[1]):
            x = X[i, k]
            if x != 0.0:
                for j in range(Y.shape[1]):
                    out[i, j] += x * Y[k, j]
    return out
