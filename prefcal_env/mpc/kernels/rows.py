"""The limits of eq. MPC_constraints as rows low <= G z <= high of the QP, compiled."""

import numpy as np

from prefcal_env.jit import inlined, inner, kernel

_LARGEST_TRUSTED_GROWTH = 1e9


@inlined()
def limit_rows(U, X, model, u_last, hard, soft, unit):  # type: ignore[no-untyped-def]
    """Return G, low and high: rows of inputs, of moves, and soft rows of limited outputs.

    y_min - ε <= y_k <= y_max + ε for k = 1 ... N_p, and ε >= 0. The last variable is
    √Q_ε ε / `unit`, so that its weight is 1 like that of a deviation.

    Args:
        U: Inputs (N_u, n_u, n_v + 1), affine in the variables, relative to `u_last`.
        X: States (N + 1, n_x, n_v + 1); N is 0 without limited outputs.
        model: C, D and e of the outputs.
        u_last: Last input.
        hard: Limits of inputs and moves.
        soft: Limits y_min and y_max, and how far each gives way: softness / √Q_ε.
        unit: Unit of the variables.
    """
    y_min, y_max, give = soft
    N_u, n_u, n_v = U.shape[0], U.shape[1], U.shape[2] - 1
    steps = X.shape[0] - 1
    limited = 0
    for j in range(len(give)):
        limited += int(np.isfinite(y_min[j])) + int(np.isfinite(y_max[j]))
    slack = 1 if limited else 0
    m = (2 * N_u - 1) * n_u + slack * (steps * limited + 1)
    G, low, high = np.zeros((m, n_v + slack)), np.full(m, -np.inf), np.full(m, np.inf)
    _input_rows(U, u_last, hard, G, low, high)
    if slack:
        at = (2 * N_u - 1) * n_u
        y = np.empty(n_v + 1)
        for sign, bound in ((1.0, y_max), (-1.0, y_min)):
            for k in range(1, steps + 1):
                for j in range(len(give)):
                    if np.isfinite(bound[j]):
                        _output(U, X, model, k, j, y)
                        for i in range(n_v):
                            G[at, i] = sign * y[i]
                        G[at, n_v] = -give[j] * unit
                        high[at] = sign * (bound[j] - y[n_v])
                        at += 1
        G[at, n_v], low[at] = 1.0, 0.0  # ε >= 0
    return G, low, high


@inner()
def reach(k, j, u_last, hard):  # type: ignore[no-untyped-def]
    """Return the lowest and highest input j of step k, relative to the last input.

    The first move is its input, so both limits hold there. If the last input lies outside its
    limits (they may have changed), the move limits may allow no input inside: then the nearest
    reachable one is the bound, and the problem stays feasible.
    """
    u_min, u_max, du_min, du_max = hard
    low, high = u_min[j] - u_last[j], u_max[j] - u_last[j]
    if low > 0.0:
        low = min(low, (k + 1) * du_max[j])
    if high < 0.0:
        high = max(high, (k + 1) * du_min[j])
    if k == 0:
        low, high = max(low, du_min[j]), min(high, du_max[j])
    return low, high


@inlined()
def _input_rows(U, u_last, hard, G, low, high):  # type: ignore[no-untyped-def]
    """Write the rows of the inputs, and of the moves after the first."""
    N_u, n_u, n_v = U.shape[0], U.shape[1], U.shape[2] - 1
    for k in range(N_u):
        for j in range(n_u):
            r, constant = k * n_u + j, U[k, j, n_v]
            for i in range(n_v):
                G[r, i] = U[k, j, i]
            lowest, highest = reach(k, j, u_last, hard)
            low[r], high[r] = lowest - constant, highest - constant
            if k > 0:
                q = r + (N_u - 1) * n_u
                for i in range(n_v):
                    G[q, i] = U[k, j, i] - U[k - 1, j, i]
                constant -= U[k - 1, j, n_v]
                low[q], high[q] = hard[2][j] - constant, hard[3][j] - constant


@inlined()
def _output(U, X, model, k, j, y):  # type: ignore[no-untyped-def]
    """Write y_k of the output j, affine in the variables."""
    C, D, e = model
    i_C, i_D, i_u = min(k, len(C) - 1), min(k, len(D) - 1), min(k, len(U) - 1)
    for i in range(len(y)):
        y[i] = 0.0
        for q in range(X.shape[1]):
            y[i] += C[i_C, j, q] * X[k, q, i]
        for q in range(U.shape[1]):
            y[i] += D[i_D, j, q] * U[i_u, q, i]
    y[len(y) - 1] += e[k, j]


@kernel()
def inputs(U, v, u_last, hard):  # type: ignore[no-untyped-def]
    """Return the inputs (N_u, n_u) of the solution v, with the first exactly within its limits.

    Rounding may violate a limit by 1e-9 of a unit, but an actuator's limit is hard.
    """
    N_u, n_u, n_v = U.shape[0], U.shape[1], U.shape[2] - 1
    out = np.empty((N_u, n_u))
    for k in range(N_u):
        for j in range(n_u):
            move = U[k, j, n_v]
            for q in range(n_v):
                move += U[k, j, q] * v[q]
            if k == 0:
                low, high = reach(k, j, u_last, hard)
                move = min(max(move, low), high)
            out[k, j] = u_last[j] + move
    return out


@inner()
def trusted(U, X, limited):  # type: ignore[no-untyped-def]
    """Return whether the rows are finite, and soft ones contain more than rounding errors.

    If the inputs are held for long, an unstable model grows until only the growing mode is left in
    an output's row. Rows of the inputs do not have this problem: their feedback is stable.
    """
    if not np.isfinite(_largest(U, 0, len(U))):
        return False
    if not limited:
        return True
    return _largest(X, 0, len(X)) < _LARGEST_TRUSTED_GROWTH * max(1.0, _largest(X, 1, 2))


@inner()
def _largest(cube, first, last):  # type: ignore[no-untyped-def]
    """Return the largest absolute value of the layers from `first` to `last`; NaN if one is NaN."""
    largest = 0.0
    for k in range(first, last):
        for q in range(cube.shape[1]):
            for i in range(cube.shape[2]):
                size = abs(cube[k, q, i])
                if size > largest or np.isnan(size):
                    largest = size
    return largest
