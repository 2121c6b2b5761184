"""One MPC step, and the extended Kalman filter of its plant, compiled."""

import math

import numpy as np

from prefcal_env.jit import inlined, inner, kernel
from prefcal_env.plants._dop853 import call
from prefcal_env.qp._active_set import SOLVED, TOLERANCE, nearest, residuals

# --- The exact zero-order hold of an affine model, compiled.
#
# The code loops over numbers and uses no slices: a single assignment to a slice takes 4 s to compile,
# while the user waits (see `prefcal_env.compiling`).

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


# --- The prediction model of one MPC step, compiled: eq. mathcalS linearized and discretized.
#
# x⁺ = A[k] x + B[k] u + c[k] and y_k = C[k] x + D[k] u + e[k], with x and u relative to the present state
# and the last input, and y absolute. k runs from 0 to N_p - 1 for the states and from 0 to N_p for the
# outputs. An array with one entry is used for all k; e always has N_p + 1 rows.


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


# --- The unconstrained optimal feedback of eq. MPC, compiled: a square-root Riccati recursion.
#
# Powers of A would fail here: the frozen CSTR grows by e^60 and more over the horizon. Powers of A lose,
# in each row, everything that is not along the growing mode, and give a Hessian of condition 1e24.
# Instead the cost-to-go is carried backward as a square-root factor S, V(x, w) = |S (x, w, 1)|², so that
# each row keeps its own relative accuracy however different the rows are in size. The plan is then the
# optimal feedback plus deviations v, whose Hessian is the identity (`plan`). This is pre-stabilized
# prediction by the array form of the Riccati recursion (Kailath, Sayed, Hassibi, "Linear Estimation",
# 2000, ch. 12, there for its dual, the filter).
#
# The code loops over numbers, uses no slices, and each argument has one type: the user waits while all of
# this compiles (see `prefcal_env.compiling`).


@kernel()
def triangularize(M, rows, columns, left):  # type: ignore[no-untyped-def]
    """Householder-reduce `columns` columns of the first `rows` rows of M, in place.

    Columns before `left` are not changed.

    Before each reflection the row with the largest entry becomes the pivot: with rows of very
    different size this makes the factorization accurate row by row (Powell and Reid, 1969;
    Cox and Higham, 1998), where plain QR is accurate only relative to the largest row.
    """
    width = M.shape[1]
    for j in range(min(columns, rows)):
        at = left + j
        pivot = j
        for i in range(j + 1, rows):
            if abs(M[i, at]) > abs(M[pivot, at]):
                pivot = i
        if M[pivot, at] == 0.0:
            continue
        if pivot != j:
            for q in range(left, width):
                M[j, q], M[pivot, q] = M[pivot, q], M[j, q]
        largest = M[j, at]
        total = 1.0
        for i in range(j + 1, rows):  # the column divided by its largest entry
            M[i, at] /= largest
            total += M[i, at] ** 2
        length = np.sqrt(total)
        # v = column + length e_j, reflection I - v vᵀ / (length (length + 1)).
        factor = 1.0 / (length * (length + 1.0))
        for q in range(at + 1, width):
            dot = (1.0 + length) * M[j, q]
            for i in range(j + 1, rows):
                dot += M[i, at] * M[i, q]
            dot *= factor
            M[j, q] -= (1.0 + length) * dot
            for i in range(j + 1, rows):
                M[i, q] -= M[i, at] * dot
        M[j, at] = -length * largest
        for i in range(j + 1, rows):
            M[i, at] = 0.0


@inlined()
def _add_cost_to_go(M, S, s, A, B, c):  # type: ignore[no-untyped-def]
    """Write rows 0 ... s - 1 of M (u, x, w, 1): S applied to (A x + B u + c, u, 1)."""
    n_x, n_u = B.shape
    for r in range(s):
        constant = S[r, n_x + n_u]
        for q in range(n_x):
            for j in range(n_u):
                M[r, j] += S[r, q] * B[q, j]
            for j in range(n_x):
                M[r, n_u + j] += S[r, q] * A[q, j]
            constant += S[r, q] * c[q]
        for j in range(n_u):
            M[r, j] += S[r, n_x + j]
        M[r, M.shape[1] - 1] = constant


@inner()
def _add_output_cost(M, top, root, C, D, e, y_ref):  # type: ignore[no-untyped-def]
    """Write rows from `top` on: root (C x + D u + e - y_ref)."""
    n_u, n_x = D.shape[1], C.shape[1]
    for r in range(root.shape[0]):
        for q in range(root.shape[1]):
            weight = root[r, q]
            if weight != 0.0:
                for j in range(n_u):
                    M[top + r, j] += weight * D[q, j]
                for j in range(n_x):
                    M[top + r, n_u + j] += weight * C[q, j]
                M[top + r, M.shape[1] - 1] += weight * (e[q] - y_ref[q])


@inlined()
def backward(A, B, c, C, D, e, roots, references, N_u):  # type: ignore[no-untyped-def]
    """Return the feedback of the N_u free stages.

    Stage k (0 ... N_p - 1) predicts x⁺ = A[k] x + B[k] u + c[k]. The cost weighs the outputs
    y_k = C[k] x + D[k] u + e[k] for k = 1 ... N_p, the last one with the last input. An array with
    one stage is used for all stages. `roots` are factors L (LᵀL = Q) of Q_y, Q_u and Q_Δu;
    `references` are y_ref, from y_1 on, u_ref, and the last input, to which u is relative. The
    last row of a reference is repeated. The state of the recursion is x and w, the previous input.

    Returns the pivot rows R[k] (n_u, 2 n_u + n_x + 1) of the N_u free stages:
    R_u u + R_x x + R_w w + R_1 = v, with cost |v|².
    """
    root_y, root_u, root_du = roots
    y_ref, u_ref, u_last = references
    last = len(y_ref) - 1
    N_p = e.shape[0] - 1
    n_x, n_u = B.shape[1], B.shape[2]
    p = root_y.shape[0]
    n_s = n_x + n_u
    width = n_u + n_s + 1
    R = np.zeros((N_u, n_u, width))
    S = np.zeros((max(n_s, p), n_s + 1))
    M = np.zeros((max(n_s, p) + p + root_u.shape[0] + root_du.shape[0], width))
    iC, iD = C.shape[0] - 1, D.shape[0] - 1
    top = np.int64(0)  # with a literal 0 numba would compile the function again for the constant
    _add_output_cost(M, top, root_y, C[min(N_p, iC)], D[min(N_p, iD)], e[N_p], y_ref[min(N_p - 1, last)])
    for r in range(p):  # y_Np depends on the last input, which is w here
        for j in range(n_x):
            S[r, j] = M[r, n_u + j]
        for j in range(n_u):
            S[r, n_x + j] = M[r, j]
        S[r, n_s] = M[r, width - 1]
    s = p
    for k in range(N_p - 1, -1, -1):
        _clear(M)
        i = min(k, A.shape[0] - 1)
        _add_cost_to_go(M, S, s, A[i], B[i], c[min(k, c.shape[0] - 1)])
        rows = s
        if k >= 1:
            i_r = min(k - 1, last)
            _add_output_cost(M, rows, root_y, C[min(k, iC)], D[min(k, iD)], e[k], y_ref[i_r])
            rows += p
        rows = _add_input_cost(M, rows, root_u, u_ref[min(k, len(u_ref) - 1)], u_last)
        if k < N_u:
            rows = _add_move_cost(M, rows, root_du, n_x)
            triangularize(M, rows, n_u + n_s, np.int64(0))
            for r in range(n_u):
                for j in range(width):
                    R[k, r, j] = M[r, j]
            top = n_u
        else:  # held: u is w, so the move is 0
            for r in range(rows):
                for j in range(n_u):
                    M[r, n_u + n_x + j] += M[r, j]
                    M[r, j] = 0.0
            triangularize(M, rows, n_s, n_u)
            top = np.int64(0)
        s = min(rows - top, n_s)
        for r in range(s):
            for j in range(n_s + 1):
                S[r, j] = M[top + r, n_u + j]
    return R


@inlined()
def _clear(M):  # type: ignore[no-untyped-def]
    for r in range(M.shape[0]):
        for j in range(M.shape[1]):
            M[r, j] = 0.0


@inlined()
def _add_input_cost(M, top, root, u_ref, u_last):  # type: ignore[no-untyped-def]
    """Write rows from `top` on: root (u_last + u - u_ref). Return the next free row."""
    for r in range(root.shape[0]):
        for j in range(root.shape[1]):
            M[top + r, j] = root[r, j]
            M[top + r, M.shape[1] - 1] -= root[r, j] * (u_ref[j] - u_last[j])
    return top + root.shape[0]


@inlined()
def _add_move_cost(M, top, root, n_x):  # type: ignore[no-untyped-def]
    """Write rows from `top` on: root (u - w). Return the next free row."""
    n_u = root.shape[1]
    for r in range(root.shape[0]):
        for j in range(n_u):
            M[top + r, j] = root[r, j]
            M[top + r, n_u + n_x + j] = -root[r, j]
    return top + root.shape[0]


# --- The plan of one MPC step, compiled: inputs and states as affine functions of the variables.
#
# The code loops over numbers, uses no slices, and each argument has one type: the user waits while all of
# this compiles (see `prefcal_env.compiling`).

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


# --- The limits of eq. MPC_constraints as rows low <= G z <= high of the QP, compiled.

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


# --- One MPC step, compiled from the measurement to the plan.

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


# --- The extended Kalman filter of a plant with constant disturbances.
#
# The estimated state is (x, p, w): disturbances p are added to outputs, w to inputs, and both stay as they
# are (see `prefcal_env.plants.plant`).


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
