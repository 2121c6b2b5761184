"""One MPC step, compiled from the measurement to the plan."""

import numpy as np

from prefcal_env.jit import inlined, kernel
from prefcal_env.qp._active_set import SOLVED, nearest
from prefcal_env.qp._kernels import TOLERANCE, residuals

from .model import at_point
from .plan import forward
from .riccati import backward
from .rows import inputs, limit_rows, trusted

DECIDED, OPEN, NOT_TRUSTED, NOT_FINITE = range(4)


@kernel()
def decide(equations, measured, model, horizons, weights, hard, soft, solver):  # type: ignore[no-untyped-def]
    """Plan in deviations from the optimal feedback, and solve the QP if the solver is compiled.

    Without active limits the plan is the feedback itself: nothing is left to solve.

    Args:
        equations: Compiled equations of the plant.
        measured: x, u, d and y_ref; d and y_ref have a row for each step, the last is repeated.
        model: Prediction model of `model.along_trajectory`; empty arrays for one at x and u.
        horizons: T_s, N_p, N_u, and N_p again if outputs are limited, otherwise 0.
        weights: Roots of Q_y, Q_u and Q_Δu, and u_ref.
        hard: Limits of inputs and moves.
        soft: Limits of the outputs, and how far they give way.
        solver: Whether it is the compiled one, its tolerances and largest number of iterations.

    Returns:
        DECIDED, OPEN (the QP is to be solved), NOT_TRUSTED or NOT_FINITE (what was measured); the
        iterations; the planned inputs (N_u, n_u); U, and the rows G, low and high, of the QP
        min ½|z|² with low <= G z <= high.
    """
    x, u, d, y_ref = measured
    if not np.isfinite(x.sum() + u.sum() + d.sum() + y_ref.sum()):
        vector, matrix, cube = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0, 0))
        return NOT_FINITE, np.int64(0), matrix, cube, matrix, vector, vector
    T_s, N_p, N_u, N_y = horizons
    found = model if len(model[0]) else at_point(equations, x, u, d, T_s, N_p, y_ref.shape[1])
    A, B, c, C, D, e = found
    root_y, root_u, root_du, u_ref = weights
    R = backward(A, B, c, C, D, e, (root_y, root_u, root_du), (y_ref, u_ref, u), N_u)
    U, X, unit = forward(A, B, c, R, N_y)
    G, low, high = limit_rows(U, X, (C, D, e), u, hard, soft, unit)
    how, iterations, plan = NOT_TRUSTED, np.int64(0), np.zeros(U.shape[:2])
    if trusted(U, X, N_y > 0):
        compiled, absolute, relative, most = solver
        if not compiled:
            most = np.int64(0)  # then only a plan without active limits is found
        ended, z, y, iterations = nearest(G, low, high, absolute, relative, most)
        how = OPEN
        if ended == SOLVED and _checked(G, low, high, z, y):
            how, plan = DECIDED, inputs(U, z, u, hard)
    return how, iterations, plan, U, G, low, high


@inlined()
def _checked(G, low, high, z, y):  # type: ignore[no-untyped-def]
    """Return whether the residuals pass the check of `prefcal_env.qp.Solution.checked`."""
    n = len(z)
    P = np.zeros((n, n))
    for i in range(n):
        P[i, i] = 1.0
    primal, reach, dual, force, gap, value = residuals(P, np.zeros(n), G, low, high, z, y)
    return primal <= TOLERANCE * reach and dual <= TOLERANCE * force and gap <= TOLERANCE * value
