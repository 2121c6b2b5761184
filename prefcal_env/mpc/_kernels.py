"""The numerics of one MPC step, compiled: discretise, optimise backward, predict forward.

Why not powers of A: the frozen CSTR grows by e^60 and more over the horizon. Powers of A lose, in
each row, all that is not along the growing mode, and a Hessian of condition 1e47 follows. Here the
cost-to-go is carried backward as a square-root factor S, V(x, w) = |S (x, w, 1)|², so each row
keeps its own relative accuracy however far the rows are apart; the plan is then written as the
unconstrained optimal feedback plus deviations v, whose Hessian is the identity. This is
pre-stabilised prediction with the square-root Riccati recursion (array algorithm; Kailath, Sayed,
Hassibi, "Linear Estimation", 2000, ch. 12, in its dual form).
"""

import numba
import numpy as np

_TAYLOR_ORDER = 14
_SMALLEST_SCALED_NORM = 0.25
_LARGEST_WEIGHT_RATIO = 1e4


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
        E = _multiply(M, E)
        for i in range(size):
            for j in range(size):
                E[i, j] = E[i, j] / k + (1.0 if i == j else 0.0)
    for _ in range(squarings):
        E = _multiply(E, E)
    return E[:n, :n].copy(), E[:n, n : n + m].copy(), E[:n, n + m].copy()


@numba.njit(cache=True)
def _multiply(X, Y):  # type: ignore[no-untyped-def]
    # Loops beat a BLAS call at these sizes (4 x 4).
    out = np.zeros((X.shape[0], Y.shape[1]))
    for i in range(X.shape[0]):
        for k in range(X.shape[1]):
            x = X[i, k]
            if x != 0.0:
                for j in range(Y.shape[1]):
                    out[i, j] += x * Y[k, j]
    return out


@numba.njit(cache=True)
def triangularise(M, rows, columns):  # type: ignore[no-untyped-def]
    """Householder-reduce the first `columns` columns of the first `rows` rows of M, in place.

    Before each reflection the row with the largest entry is brought to the pivot: with rows of
    very different size this makes the factorisation accurate row by row (Powell and Reid, 1969;
    Cox and Higham, 1998), where plain QR is accurate only against the largest row.
    """
    width = M.shape[1]
    for j in range(min(columns, rows)):
        pivot = j
        for i in range(j + 1, rows):
            if abs(M[i, j]) > abs(M[pivot, j]):
                pivot = i
        if M[pivot, j] == 0.0:
            continue
        if pivot != j:
            for q in range(width):
                M[j, q], M[pivot, q] = M[pivot, q], M[j, q]
        largest = M[j, j]
        total = 0.0
        for i in range(j, rows):
            total += (M[i, j] / largest) ** 2
        length = np.sqrt(total)  # of the column divided by its largest entry, so head is 1
        # v = column / largest + length e_j, reflection I - v vᵀ / (length (length + 1)).
        factor = 1.0 / (length * (length + 1.0))
        for q in range(j + 1, width):
            dot = (1.0 + length) * M[j, q]
            for i in range(j + 1, rows):
                dot += M[i, j] / largest * M[i, q]
            dot *= factor
            M[j, q] -= (1.0 + length) * dot
            for i in range(j + 1, rows):
                M[i, q] -= M[i, j] / largest * dot
        M[j, j] = -length * largest
        for i in range(j + 1, rows):
            M[i, j] = 0.0


@numba.njit(cache=True)
def backward(A, B, c, C, D, e, sqrt_Qy, sqrt_Qu, sqrt_Qdu, u_ref, N_u):  # type: ignore[no-untyped-def]
    """Unconstrained optimal feedback of eq. MPC by a square-root Riccati recursion.

    Stage k (0 ... N_p - 1) predicts x⁺ = A[k] x + B[k] u + c[k]; output y_k - y_ref =
    C[k] x + D[k] u + e[k] counts for k = 1 ... N_p, the last with the last input. An array with
    one stage stands for all. State of the recursion: x and w, the previous input.

    Returns the pivot rows R[k] (n_u, 2 n_u + n_x + 1) of the N_u free stages:
    R_u u + R_x x + R_w w + R_1 = v, with cost |v|².
    """
    N_p = e.shape[0] - 1
    n_x, n_u = B.shape[1], B.shape[2]
    p, p_u, p_du = sqrt_Qy.shape[0], sqrt_Qu.shape[0], sqrt_Qdu.shape[0]
    width = 2 * n_u + n_x + 1
    last = width - 1
    n_s = n_x + n_u
    R = np.zeros((N_u, n_u, width))
    S = np.zeros((max(n_s, p), n_s + 1))
    M = np.zeros((max(n_s, p) + p + p_u + p_du, width))
    iC, iD = C.shape[0] - 1, D.shape[0] - 1
    S[:p, :n_x] = _multiply(sqrt_Qy, C[min(N_p, iC)])
    S[:p, n_x:n_s] = _multiply(sqrt_Qy, D[min(N_p, iD)])
    S[:p, n_s] = np.dot(sqrt_Qy, e[N_p])
    s = p
    for k in range(N_p - 1, -1, -1):
        i = min(k, A.shape[0] - 1)
        M[:, :] = 0.0
        for r in range(s):
            constant = S[r, n_s]
            for q in range(n_x):
                S_rq = S[r, q]
                if S_rq != 0.0:
                    for j in range(n_u):
                        M[r, j] += S_rq * B[i, q, j]
                    for j in range(n_x):
                        M[r, n_u + j] += S_rq * A[i, q, j]
                    constant += S_rq * c[min(k, c.shape[0] - 1), q]
            for j in range(n_u):
                M[r, j] += S[r, n_x + j]
            M[r, last] = constant
        rows = s
        if k >= 1:
            for r in range(p):
                for q in range(sqrt_Qy.shape[1]):
                    weight = sqrt_Qy[r, q]
                    if weight != 0.0:
                        for j in range(n_u):
                            M[rows, j] += weight * D[min(k, iD), q, j]
                        for j in range(n_x):
                            M[rows, n_u + j] += weight * C[min(k, iC), q, j]
                        M[rows, last] += weight * e[k, q]
                rows += 1
        for r in range(p_u):
            for j in range(n_u):
                M[rows, j] = sqrt_Qu[r, j]
                M[rows, last] -= sqrt_Qu[r, j] * u_ref[min(k, u_ref.shape[0] - 1), j]
            rows += 1
        if k < N_u:
            for r in range(p_du):
                for j in range(n_u):
                    M[rows, j] = sqrt_Qdu[r, j]
                    M[rows, n_u + n_x + j] = -sqrt_Qdu[r, j]
                rows += 1
            triangularise(M, rows, n_u + n_s)
            R[k] = M[:n_u]
            top = n_u
        else:  # held: u is w, and its move is 0
            for r in range(rows):
                for j in range(n_u):
                    M[r, n_u + n_x + j] += M[r, j]
                    M[r, j] = 0.0
            triangularise(M[:, n_u:], rows, n_s)
            top = 0
        s = min(rows - top, n_s)
        S[:s] = M[top : top + s, n_u:]
    return R


@numba.njit(cache=True)
def forward(A, B, c, R, N_y):  # type: ignore[no-untyped-def]
    """Inputs and states as affine functions of the deviations v (last column: constant).

    From x = 0 and w = 0. Returns U (N_u, n_u, n_v + 1), X (N_y + 1, n_x, n_v + 1), where N_y is
    how far the states are wanted (behind N_u the last input is held), and the unit of v: the
    smallest of their weights, so that v moves an input by about its own size and a solver's
    tolerance on v means as much for the inputs.

    A deviation whose weight is far above those of the same input elsewhere is what nothing later
    can correct (the growing mode, once the input is held). Its weight is cut to 1e4 times theirs:
    the exact one would put it at zero, or at the nearest reachable, to 20 digits, this one to 8.
    """
    N_u, n_u = R.shape[0], R.shape[1]
    n_x = A.shape[1]
    n_v = N_u * n_u
    U = np.zeros((N_u, n_u, n_v + 1))
    X = np.zeros((max(N_u, N_y) + 1, n_x, n_v + 1))
    W = np.zeros((n_u, n_v + 1))
    smallest = np.empty(n_u)
    for j in range(n_u):
        smallest[j] = np.inf
        for k in range(N_u):
            smallest[j] = min(smallest[j], abs(R[k, j, j]))
    unit = smallest.min()
    for k in range(max(N_u, N_y)):
        i = min(k, A.shape[0] - 1)
        if k < N_u:
            for j in range(n_u - 1, -1, -1):  # back substitution
                inverse = 1.0 / R[k, j, j]
                row = U[k, j]
                for q in range(n_x):
                    row -= R[k, j, n_u + q] * inverse * X[k, q]
                for q in range(n_u):
                    row -= R[k, j, n_u + n_x + q] * inverse * W[q]
                for q in range(j + 1, n_u):
                    row -= R[k, j, q] * inverse * U[k, q]
                row[n_v] -= R[k, j, n_u + n_x + n_u] * inverse
                weight = min(abs(R[k, j, j]), _LARGEST_WEIGHT_RATIO * smallest[j])
                row[k * n_u + j] += unit / weight
            W[:, :] = U[k]
        for a in range(n_x):
            for q in range(n_x):
                X[k + 1, a] += A[i, a, q] * X[k, q]
            for q in range(n_u):
                X[k + 1, a] += B[i, a, q] * W[q]
            X[k + 1, a, n_v] += c[min(k, c.shape[0] - 1), a]
    return U, X, unit


@numba.njit(cache=True)
def input_rows(U, u_last, u_min, u_max, du_min, du_max):  # type: ignore[no-untyped-def]
    """Rows l <= G v <= h of the inputs' and the moves' limits of eq. MPC_constraints.

    The first move is its input, so one row holds both limits. When the last input lies outside
    its limits (they may have changed), no input that the move limits allow may be inside: then
    the nearest reachable one is the bound, and the problem stays feasible.
    """
    N_u, n_u, width = U.shape
    n_v = width - 1
    G = np.empty(((2 * N_u - 1) * n_u, n_v))
    low, high = np.empty(len(G)), np.empty(len(G))
    for k in range(N_u):
        for j in range(n_u):
            r = k * n_u + j
            G[r] = U[k, j, :n_v]
            low[r] = u_min[j] - u_last[j]
            high[r] = u_max[j] - u_last[j]
            if low[r] > 0.0:
                low[r] = min(low[r], (k + 1) * du_max[j])
            if high[r] < 0.0:
                high[r] = max(high[r], (k + 1) * du_min[j])
            if k == 0:
                low[r] = max(low[r], du_min[j])
                high[r] = min(high[r], du_max[j])
            else:
                q = r + (N_u - 1) * n_u
                G[q] = U[k, j, :n_v] - U[k - 1, j, :n_v]
                constant = U[k, j, n_v] - U[k - 1, j, n_v]
                low[q] = du_min[j] - constant
                high[q] = du_max[j] - constant
            low[r] -= U[k, j, n_v]
            high[r] -= U[k, j, n_v]
    return G, low, high


@numba.njit(cache=True)
def plan(U, v, u_last, low, high):  # type: ignore[no-untyped-def]
    """Inputs (N_u, n_u) of the solution v, the first within its rows' limits to the last bit.

    Rounding may leave a limit by 1e-9 of a unit; an actuator's limit is hard.
    """
    N_u, n_u, width = U.shape
    n_v = width - 1
    out = np.empty((N_u, n_u))
    for k in range(N_u):
        for j in range(n_u):
            move = 0.0
            for q in range(n_v):
                move += U[k, j, q] * v[q]
            if k == 0:
                move = min(max(move, low[j]), high[j])
            out[k, j] = u_last[j] + (U[k, j, n_v] + move)
    return out


@numba.njit(cache=True)
def open_loop(A, B, c, R, N_y):  # type: ignore[no-untyped-def]
    """The same plan with the inputs themselves as variables: `forward` and the cost rows T.

    Returns U and X as `forward`, here affine in the inputs, and T (n_v, n_v + 1) with the
    deviations v = T (u, 1), so that the cost is |T (u, 1)|². Rows of T may grow like the plant.
    """
    N_u, n_u = R.shape[0], R.shape[1]
    n_x = A.shape[1]
    n_v = N_u * n_u
    U = np.zeros((N_u, n_u, n_v + 1))
    X = np.zeros((max(N_u, N_y) + 1, n_x, n_v + 1))
    W = np.zeros((n_u, n_v + 1))
    T = np.zeros((n_v, n_v + 1))
    for k in range(max(N_u, N_y)):
        i = min(k, A.shape[0] - 1)
        if k < N_u:
            for j in range(n_u):
                U[k, j, k * n_u + j] = 1.0
            for j in range(n_u):
                row = T[k * n_u + j]
                for q in range(n_u):
                    row += R[k, j, q] * U[k, q] + R[k, j, n_u + n_x + q] * W[q]
                for q in range(n_x):
                    row += R[k, j, n_u + q] * X[k, q]
                row[n_v] += R[k, j, n_u + n_x + n_u]
            W[:, :] = U[k]
        for a in range(n_x):
            for q in range(n_x):
                X[k + 1, a] += A[i, a, q] * X[k, q]
            for q in range(n_u):
                X[k + 1, a] += B[i, a, q] * W[q]
            X[k + 1, a, n_v] += c[min(k, c.shape[0] - 1), a]
    return U, X, T


@numba.njit(cache=True)
def condense(A, B, c, C, D, e, roots, u_ref, N_u, N_y, u_last, limits):  # type: ignore[no-untyped-def]
    """`backward`, `forward` and `input_rows` in one call: what every step needs."""
    R = backward(A, B, c, C, D, e, roots[0], roots[1], roots[2], u_ref - u_last, N_u)
    U, X, unit = forward(A, B, c, R, N_y)
    G, low, high = input_rows(U, u_last, limits[0], limits[1], limits[2], limits[3])
    return R, U, X, unit, G, low, high
