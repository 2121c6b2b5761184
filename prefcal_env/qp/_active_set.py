"""Compiled: a dual active-set method, and the check after a solve."""

import math

import numpy as np

from prefcal_env.jit import inlined, inner, kernel

# --- The compiled check after a solve; in numpy it costs as much as the solve itself.
#
# It loops over numbers only: whole-array expressions take several times as long to compile.

TOLERANCE = 1e-6  # share of its scale by which a residual of a solution may differ from 0


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


# --- A compiled dual active-set method for the nearest point to the origin within linear limits.
#
# Source: Goldfarb, Idnani (1983), A numerically stable dual method for solving strictly convex quadratic
# programs, Mathematical Programming 27, with the identity as Hessian: an MPC in deviations from its
# optimal feedback (`prefcal_env.mpc.kernels`) is such a problem.

SOLVED, INFEASIBLE, ITERATION_LIMIT = 0, 1, 2
_ZERO = 1e-13  # share of a normal, outside the span of the active ones, below which it counts as inside


@kernel()
def nearest(G, low, high, absolute, relative, most):  # type: ignore[no-untyped-def]
    """Minimize ½|z|² subject to low <= G z <= high.

    A row may be violated by `absolute` + `relative` times the size of its terms. Each row that
    becomes active or inactive is an iteration, at most `most`.

    Returns:
        How it ended, z (n,), multipliers (m,), positive at upper limits, and iterations.
    """
    m, n = G.shape
    z, y = np.zeros(n), np.zeros(m)
    if _at_origin(low, high):
        return SOLVED, z, y, np.int64(0)
    # J is orthogonal, and JᵀN = (R, 0) for the normals N of the k active rows.
    factors = np.eye(n), np.zeros((n, n))
    active = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)  # row, side and multiplier
    # With literal zeros numba would compile `_activate` twice.
    norms, k, iterations = _norms(G), np.int64(0), np.int64(0)
    while True:
        worst = _most_violated(G, low, high, norms, z, absolute, relative)
        if worst[0] < 0:
            for j in range(k):
                y[active[0][j]] += active[1][j] * active[2][j]
            return SOLVED, z, y, iterations
        how, k, iterations = _activate(G, worst, norms, z, factors, active, k, iterations, most)
        if how != SOLVED:
            return how, z, y, iterations


@inlined()
def _activate(G, worst, norms, z, factors, active, k, iterations, most):  # type: ignore[no-untyped-def]
    """Move z to the limit of a violated row, and drop active rows that are in the way.

    Returns how it ended, the number of active rows, and the iterations so far.
    """
    p, side, violation = worst
    (J, R), (rows, sides, mu), n = factors, active, len(z)
    a, d, r, step = np.empty(n), np.empty(n), np.zeros(n), np.empty(n)
    for j in range(n):
        a[j] = -side * G[p, j]
    push = 0.0
    while iterations < most:
        iterations += 1
        free = _directions(J, R, a, k, d, r, step)
        partial, blocking = np.inf, -1
        for j in range(k):
            if r[j] > 0.0 and mu[j] < partial * r[j]:
                partial, blocking = mu[j] / r[j], j
        full = violation / free if free > (_ZERO * norms[p]) ** 2 else np.inf
        t = min(partial, full)
        if t == np.inf:
            return INFEASIBLE, k, iterations
        for j in range(k):
            mu[j] -= t * r[j]
        push += t
        if full < np.inf:
            violation -= t * free
            for j in range(n):
                z[j] += t * step[j]
        if full <= partial:
            _add(J, R, d, k)
            rows[k], sides[k], mu[k] = p, side, push
            return SOLVED, k + 1, iterations
        _drop(J, R, rows, sides, mu, blocking, k)
        k -= 1
    return ITERATION_LIMIT, k, iterations


@inlined()
def _norms(G):  # type: ignore[no-untyped-def]
    """Return the length of each row."""
    norms = np.zeros(G.shape[0])
    for i in range(G.shape[0]):
        for j in range(G.shape[1]):
            norms[i] += G[i, j] * G[i, j]
        norms[i] = math.sqrt(norms[i])
    return norms


@inlined()
def _at_origin(low, high):  # type: ignore[no-untyped-def]
    """Return whether the origin is within all limits."""
    for i in range(len(low)):  # noqa: SIM110 (numba compiles no generator)
        if not (low[i] <= 0.0 <= high[i]):
            return False
    return True


@inlined()
def _most_violated(G, low, high, norms, z, absolute, relative):  # type: ignore[no-untyped-def]
    """Return the most violated row or -1, its side (1: above its limit), and by how much."""
    worst, side, violation, largest = -1, 1.0, 0.0, 0.0
    for i in range(G.shape[0]):
        value, size = 0.0, 0.0
        for j in range(G.shape[1]):
            term = G[i, j] * z[j]
            value += term
            size += abs(term)
        over, under = value - high[i], low[i] - value
        excess = max(over, under)
        if excess > absolute + relative * size and excess > largest * norms[i]:
            largest = excess / norms[i] if norms[i] > 0.0 else np.inf
            worst, violation = i, excess
            side = 1.0 if over > under else -1.0
    return worst, side, violation


@inlined()
def _directions(J, R, a, k, d, r, step):  # type: ignore[no-untyped-def]
    """Write d = Jᵀa, the steps of z and of the k multipliers; return the squared step of z."""
    n = len(a)
    for j in range(n):
        d[j] = 0.0
    for i in range(n):
        if a[i] != 0.0:
            for j in range(n):
                d[j] += J[i, j] * a[i]
    free = 0.0
    for j in range(k, n):
        free += d[j] * d[j]
    for i in range(n):
        step[i] = 0.0
        for j in range(k, n):
            step[i] += J[i, j] * d[j]
    for i in range(k - 1, -1, -1):
        r[i] = d[i]
        for j in range(i + 1, k):
            r[i] -= R[i, j] * r[j]
        r[i] /= R[i, i]
    return free


@inner()
def _rotate(M, i, j, c, s):  # type: ignore[no-untyped-def]
    """Rotate the columns i and j of M."""
    for q in range(M.shape[0]):
        one, other = M[q, i], M[q, j]
        M[q, i] = c * one + s * other
        M[q, j] = c * other - s * one


@inlined()
def _add(J, R, d, k):  # type: ignore[no-untyped-def]
    """Make d the column k of R, and J the orthogonal matrix that goes with it."""
    for j in range(len(d) - 1, k, -1):
        if d[j] != 0.0:
            length = math.hypot(d[j - 1], d[j])
            c, s = d[j - 1] / length, d[j] / length
            d[j - 1], d[j] = length, 0.0
            _rotate(J, j - 1, j, c, s)
    for i in range(k + 1):
        R[i, k] = d[i]


@inlined()
def _drop(J, R, rows, sides, mu, gone, k):  # type: ignore[no-untyped-def]
    """Remove the active row number `gone` of k, and restore R to a triangle."""
    for j in range(gone, k - 1):
        rows[j], sides[j], mu[j] = rows[j + 1], sides[j + 1], mu[j + 1]
        for i in range(k):
            R[i, j] = R[i, j + 1]
    for j in range(gone, k - 1):
        length = math.hypot(R[j, j], R[j + 1, j])
        c, s = R[j, j] / length, R[j + 1, j] / length
        for q in range(j, k - 1):
            one, other = R[j, q], R[j + 1, q]
            R[j, q] = c * one + s * other
            R[j + 1, q] = c * other - s * one
        _rotate(J, j, j + 1, c, s)
