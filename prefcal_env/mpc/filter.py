"""The extended Kalman filter of a plant with constant disturbances, compiled.

The estimated state is (x, p, w): disturbances p are added to outputs, w to inputs, and both stay as
they are (see `prefcal_env.plants.plant`).
"""

import math

import numpy as np

from prefcal_env.jit import inlined, inner, kernel

from .kernels import discretize, jacobians, multiply, outputs


@kernel()
def linearize(equations, x, u, d, n_y):  # type: ignore[no-untyped-def]
    """Return A = ∂ẋ/∂(x, p, w) and C = ∂y/∂(x, p, w); d ends with p and w."""
    on_y, on_u = equations[4], equations[5]
    n_x, n_p = len(x), len(on_y)
    n = n_x + n_p + len(on_u)
    of_x, of_u = np.empty((n_y, n_x)), np.empty((n_y, len(u)))
    # The rows of p and w stay 0: disturbances that integrate have no rate of their own.
    A, C = np.zeros((n, n)), np.zeros((n_y, n))
    A_x, B = jacobians(equations, x, u, d, of_x, of_u)
    for i in range(n_x):
        for j in range(n_x):
            A[i, j] = A_x[i, j]
        for j in range(len(on_u)):
            # w acts where the input does, so its column is that of the input.
            A[i, n_x + n_p + j] = B[i, on_u[j]]
    for i in range(n_y):
        for j in range(n_x):
            C[i, j] = of_x[i, j]
        for j in range(len(on_u)):
            C[i, n_x + n_p + j] = of_u[i, on_u[j]]
    for j in range(n_p):
        # p is added to its output as it is.
        C[on_y[j], n_x + j] = 1.0
    return A, C


@kernel()
def carried(equations, middles, u, d, P, Q, T, n_y):  # type: ignore[no-untyped-def]
    """Return the covariance F P Fᵀ + Q after pieces of length T, linearized in their middles."""
    n = P.shape[0]
    # Only F is needed: inputs and drift shift the mean alone.
    F, no_input, no_drift = np.eye(n), np.zeros((n, 0)), np.zeros(n)
    for k in range(len(middles)):
        A, _ = linearize(equations, middles[k], u, d, n_y)
        # From the left: the last piece acts last.
        F = multiply(discretize(A, no_input, no_drift, T)[0], F)
    return _sum(_sandwich(F, P), Q)


@kernel()
def updated(equations, x, u, d, P, R, y):  # type: ignore[no-untyped-def]
    """Return mean (n,) and covariance (n, n) after the outputs `y` are measured.

    The covariance is in the form of Joseph, which keeps it positive semidefinite.
    """
    n, n_y = P.shape[0], len(y)
    _, C = linearize(equations, x, u, d, n_y)
    predicted, mean = np.empty(n_y), np.empty(n)
    outputs(equations, x, u, d, predicted)
    CP = multiply(C, P)
    # The Kalman gain P Cᵀ (C P Cᵀ + R)⁻¹; its inverse exists, since every output has some noise.
    K = _gain(_sum(_sandwich(C, P), R), CP)
    for i in range(n):
        # p and w stand at the end of d, behind the measured disturbances.
        mean[i] = x[i] if i < len(x) else d[len(d) - n + i]
        for j in range(n_y):
            mean[i] += K[i, j] * (y[j] - predicted[j])
    kept = np.eye(n)
    for i in range(n):
        for j in range(n):
            for q in range(n_y):
                kept[i, j] -= K[i, q] * C[q, j]
    # (1 - K C) P (1 - K C)ᵀ + K R Kᵀ: (1 - K C) P alone is as good on paper, and loses its symmetry here.
    return mean, _sum(_sandwich(kept, P), _sandwich(K, R))


@inner()
def _sandwich(M, P):  # type: ignore[no-untyped-def]
    """Return M P Mᵀ, exactly symmetric, for a symmetric P."""
    MP, out = multiply(M, P), np.zeros((M.shape[0], M.shape[0]))
    for i in range(M.shape[0]):
        for j in range(i + 1):
            for q in range(M.shape[1]):
                out[i, j] += MP[i, q] * M[j, q]
            out[j, i] = out[i, j]
    return out


@inner()
def _sum(A, B):  # type: ignore[no-untyped-def]
    """Return A + B; a whole-array expression would take long to compile."""
    out = np.empty(A.shape)
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i, j] = A[i, j] + B[i, j]
    return out


@inlined()
def _gain(S, CP):  # type: ignore[no-untyped-def]
    """Return K = (S⁻¹ CP)ᵀ, by a Cholesky factor of S."""
    n_y, n = CP.shape
    L, K = np.zeros((n_y, n_y)), np.zeros((n, n_y))
    for i in range(n_y):
        for j in range(i + 1):
            rest = S[i, j]
            for q in range(j):
                rest -= L[i, q] * L[j, q]
            # Rounding may leave less than 0 where outputs are nearly the same.
            L[i, j] = math.sqrt(max(rest, 0.0)) if i == j else rest / L[j, j]
    for a in range(n):
        for i in range(n_y):
            rest = CP[i, a]
            for q in range(i):
                rest -= L[i, q] * K[a, q]
            K[a, i] = rest / L[i, i]
        # Forward with L above, backward with Lᵀ here: two triangular solves instead of an inverse.
        for i in range(n_y - 1, -1, -1):
            for q in range(i + 1, n_y):
                K[a, i] -= L[q, i] * K[a, q]
            K[a, i] /= L[i, i]
    return K
