"""Eq. MPC to 300 digits: dense prediction by powers and a primal active set, in gmpy2.

Slow, plain, and sharing nothing with the controller but the plant's derivatives. Numbers are
mpfr of 1,000 bits in numpy object arrays; sums of them are as exact as it takes for a condition
of 1e120.
"""

from dataclasses import dataclass

import gmpy2
import numpy as np
from gmpy2 import mpfr

BITS = 1000


def exact(array):
    """Float array to an object array of mpfr (every float is represented exactly)."""
    return np.vectorize(lambda v: mpfr(float(v), BITS), otypes=[object])(np.asarray(array, float))


def zeros(*shape):
    return exact(np.zeros(shape))


def hold(A, B, c, T):
    """Zero-order hold by the exponential of the augmented matrix, scaling and Taylor."""
    n, m = B.shape
    M = zeros(n + m + 1, n + m + 1)
    M[:n, :n], M[:n, n : n + m], M[:n, n + m] = A * T, B * T, c * T
    M = M / mpfr(2) ** 12
    E, term = exact(np.eye(n + m + 1)), exact(np.eye(n + m + 1))
    for k in range(1, 140):
        term = term.dot(M) / k
        E = E + term
    for _ in range(12):
        E = E.dot(E)
    return E[:n, :n], E[:n, n : n + m], E[:n, n + m]


def solve(K, b):
    """Gaussian elimination with partial pivoting."""
    K, b = K.copy(), b.copy()
    n = len(b)
    for j in range(n):
        p = j + int(np.argmax([abs(v) for v in K[j:, j]]))
        if p != j:
            K[[j, p]], b[[j, p]] = K[[p, j]], b[[p, j]]
        for i in range(j + 1, n):
            if K[i, j] != 0:
                factor = K[i, j] / K[j, j]
                K[i, j:] = K[i, j:] - factor * K[j, j:]
                b[i] = b[i] - factor * b[j]
    x = zeros(n)
    for i in range(n - 1, -1, -1):
        x[i] = (b[i] - (K[i, i + 1 :].dot(x[i + 1 :]) if i + 1 < n else 0)) / K[i, i]
    return x


@dataclass
class Dense:
    """min ½ zᵀH z + hᵀz, G z <= g; z are the N_u single inputs relative to the last one."""

    H: np.ndarray
    h: np.ndarray
    G: np.ndarray
    g: np.ndarray


def single_input_problem(plant, x, u, d, y_ref, settings):
    """Eq. MPC with "point" linearization of a plant with one input."""
    J = plant.jacobians(x, u, d)
    A, B, c = hold(exact(J.A), exact(J.B), exact(plant.f(x, u, d)), mpfr(settings.T_s, BITS))
    N_p, N_u = settings.N_p, settings.N_u
    Q_y, C = exact(settings.Q_y), exact(J.C)
    error = exact(plant.g(x, u, d)) - exact(y_ref)
    H, h = zeros(N_u, N_u), zeros(N_u)
    state = zeros(len(x), N_u + 1)  # affine in z, the last column constant
    for k in range(N_p):
        state = A.dot(state)
        state[:, min(k, N_u - 1)] = state[:, min(k, N_u - 1)] + B[:, 0]
        state[:, N_u] = state[:, N_u] + c
        y = C.dot(state)
        y[:, N_u] = y[:, N_u] + error
        H = H + y[:, :N_u].T.dot(Q_y).dot(y[:, :N_u])
        h = h + y[:, :N_u].T.dot(Q_y).dot(y[:, N_u])
    moves = exact(np.eye(N_u) - np.eye(N_u, k=-1))
    H = H + moves.T.dot(moves) * exact(settings.Q_du)[0, 0]
    eye = exact(np.eye(N_u))
    G = np.vstack([eye, -eye, moves, -moves])
    ones = exact(np.ones(N_u))
    last = exact(u)[0]
    g = np.concatenate(
        [
            ones * (mpfr(plant.inputs[0].high) - last),
            ones * (last - mpfr(plant.inputs[0].low)),
            ones * mpfr(settings.du_max[0]),
            ones * -mpfr(settings.du_min[0]),
        ]
    )
    return Dense(H, h, G, g)


def minimize(problem, start):
    """Primal active set from the feasible point that rounds `start` to its active rows."""
    p = problem
    z, active = _vertexlike(p, start)
    for _ in range(400):
        n, a = len(z), len(active)
        K = zeros(n + a, n + a)
        K[:n, :n] = p.H
        K[:n, n:], K[n:, :n] = p.G[active].T, p.G[active]
        step = solve(K, np.concatenate([-(p.H.dot(z) + p.h), zeros(a)]))
        direction, multipliers = step[:n], step[n:]
        ratios = []
        slope, room = p.G.dot(direction), p.g - p.G.dot(z)
        for i in range(len(p.g)):
            if i not in active and slope[i] > mpfr(10) ** -150:
                ratios.append((max(room[i], mpfr(0)) / slope[i], i))
        length, blocking = min(ratios, default=(mpfr(2), -1))
        if length < 1:
            z = z + direction * length
            active = [*active, blocking]
            continue
        z = z + direction
        worst = min(range(a), key=lambda i: multipliers[i], default=None)
        if worst is None or multipliers[worst] >= 0:
            return z
        active = [v for i, v in enumerate(active) if i != worst]
    raise AssertionError("the reference did not converge")


def _vertexlike(p, start):
    """A feasible point near `start` with inputs set exactly on near-active rows, one a stage."""
    n = len(start)
    z, active = zeros(n), []
    upper, lower, rise, fall = (p.g[i * n : (i + 1) * n] for i in range(4))
    for k in range(n):
        before = z[k - 1] if k else mpfr(0)
        low, high = max(-lower[k], before - fall[k]), min(upper[k], before + rise[k])
        if start[k] >= high - 1e-4:
            z[k] = high
            active.append(k if high == upper[k] else 2 * n + k)
        elif start[k] <= low + 1e-4:
            z[k] = low
            active.append(n + k if low == -lower[k] else 3 * n + k)
        else:
            z[k] = mpfr(float(start[k]), BITS)
    return z, active


def with_precision(function, *args):
    """Run `function` with `BITS` bits."""
    with gmpy2.context(precision=BITS):
        return function(*args)
