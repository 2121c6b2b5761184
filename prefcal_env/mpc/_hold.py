"""The exact zero-order hold of an affine model, compiled.

numba keeps what it compiled beside each file and looks at that file alone to see whether it is
stale: after a change here, touch the files that import this one.
"""

import numba
import numpy as np

_TAYLOR_ORDER = 14
_SMALLEST_SCALED_NORM = 0.25


@numba.njit(cache=True)
def discretise(A, B, c, T):  # type: ignore[no-untyped-def]
    """Zero-order hold of ẋ = A x + B u + c over T: x⁺ = A_d x + B_d u + c_d, exact.

    The exponential of [[A, B, c], [0, 0, 0]] T by scaling and squaring of its Taylor series.
    """
    n, m = B.shape
    size = n + m + 1
    M = np.zeros((size, size))
    M[:n, :n] = A * T
    M[:n, n : n + m] = B * T
    M[:n, n + m] = c * T
    norm = 0.0
    for i in range(n):
        norm = max(norm, np.abs(M[i, :n]).sum())
    squarings = 0
    while norm > _SMALLEST_SCALED_NORM:
        norm /= 2
        squarings += 1
    M /= 2.0**squarings
    # Horner: I + M (I + M/2 (I + M/3 ...)).
    E = np.eye(size)
    for k in range(_TAYLOR_ORDER, 0, -1):
        E = multiply(M, E)
        for i in range(size):
            for j in range(size):
                E[i, j] = E[i, j] / k + (1.0 if i == j else 0.0)
    for _ in range(squarings):
        E = multiply(E, E)
    return E[:n, :n].copy(), E[:n, n : n + m].copy(), E[:n, n + m].copy()


@numba.njit(cache=True)
def multiply(X, Y):  # type: ignore[no-untyped-def]
    # Loops beat a BLAS call at these sizes (4 x 4).
    out = np.zeros((X.shape[0], Y.shape[1]))
    for i in range(X.shape[0]):
        for k in range(X.shape[1]):
            x = X[i, k]
            if x != 0.0:
                for j in range(Y.shape[1]):
                    out[i, j] += x * Y[k, j]
    return out
