"""The unconstrained optimal feedback of eq. MPC, compiled: a square-root Riccati recursion.

Powers of A would fail here: the frozen CSTR grows by e^60 and more over the horizon. Powers of A
lose, in each row, everything that is not along the growing mode, and give a Hessian of condition
1e24. Instead the cost-to-go is carried backward as a square-root factor S,
V(x, w) = |S (x, w, 1)|², so that each row keeps its own relative accuracy however different the
rows are in size. The plan is then the optimal feedback plus deviations v, whose Hessian is the
identity (`plan`). This is pre-stabilized prediction by the array form of the Riccati recursion
(Kailath, Sayed, Hassibi, "Linear Estimation", 2000, ch. 12, there for its dual, the filter).

The code loops over numbers, uses no slices, and each argument has one type: the user waits while
all of this compiles (see `prefcal_env.compiling`).
"""

import numpy as np

from prefcal_env.jit import inlined, inner, kernel


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
