"""A linear plant with two inputs, feedthrough and a measured disturbance; and eq. MPC for it.

`dense_moves` writes eq. MPC and eq. MPC_constraints down as they stand, in the inputs and the
slack, by powers of A. That is fine for a stable plant and shares nothing with the controller.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm

from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Jacobians
from prefcal_env.qp import QP
from support.daqp_backend import DAQPBackend


@dataclass(frozen=True)
class LinearPlant:
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray
    name: str = "linear"
    time_unit: str = "s"
    inputs: tuple = field(default=())

    @property
    def states(self):
        return tuple(Channel(f"x{i}") for i in range(len(self.A)))

    @property
    def outputs(self):
        return tuple(Channel(f"y{i}") for i in range(len(self.C)))

    @property
    def disturbances(self):
        return tuple(Channel(f"d{i}") for i in range(self.E.shape[1]))

    def f(self, x, u, d):
        return self.A @ x + self.B @ u + self.E @ d

    def g(self, x, u, d):
        return self.C @ x + self.D @ u

    def jacobians(self, x, u, d):
        return Jacobians(self.A, self.B, self.C, self.D)

    def hold(self, x, u, d, times):
        return np.array([self._hold(t) @ np.concatenate([x, u, d]) for t in times])

    def _hold(self, T):
        n, m = len(self.A), self.B.shape[1] + self.E.shape[1]
        M = np.zeros((n + m, n + m))
        M[:n] = np.hstack([self.A, self.B, self.E])
        return expm(M * T)[:n]


def random_plant(seed, n_x=3, n_u=2, n_y=2, feedthrough=True):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n_x, n_x))
    A -= (max(np.linalg.eigvals(A).real) + 0.2) * np.eye(n_x)
    D = rng.normal(size=(n_y, n_u)) if feedthrough else np.zeros((n_y, n_u))
    return LinearPlant(
        A,
        rng.normal(size=(n_x, n_u)),
        rng.normal(size=(n_y, n_x)),
        D,
        rng.normal(size=(n_x, 1)),
        inputs=tuple(Channel(f"u{i}", low=-1.0, high=1.5) for i in range(n_u)),
    )


def rows(preview, k):
    """Row k of a preview, its last row holding on; a constant for any k."""
    return preview if preview.ndim == 1 else preview[min(k, len(preview) - 1)]


def dense_moves(plant, s, m):
    """First input of eq. MPC, the slack, and whether the limits were soft."""
    n_u, n_y = len(plant.inputs), len(plant.outputs)
    n_z = s.N_u * n_u + 1
    hold = plant._hold(s.T_s)
    n_x = len(plant.A)
    A, B, E = hold[:, :n_x], hold[:, n_x : n_x + n_u], hold[:, n_x + n_u :]

    def u(k):
        out = np.zeros((n_u, n_z + 1))
        first = min(k, s.N_u - 1) * n_u
        out[:, first : first + n_u] = np.eye(n_u)
        return out

    H, G, high = np.zeros((n_z + 1, n_z + 1)), [], []
    Q_u = np.zeros((n_u, n_u)) if s.Q_u is None else np.array(s.Q_u)
    u_ref = np.zeros(n_u) if s.u_ref is None else np.array(s.u_ref)
    state, before = np.zeros((n_x, n_z + 1)), np.zeros((n_u, n_z + 1))
    state[:, -1], before[:, -1] = m.x, m.u
    softness = np.ones(n_y) if s.softness is None else np.array(s.softness)
    for k in range(s.N_p):
        deviation = u(k)
        deviation[:, -1] -= rows(u_ref, k)
        move = u(k) - before
        H += deviation.T @ Q_u @ deviation + move.T @ np.array(s.Q_du) @ move
        for row, low, top in (
            (u(k), [c.low for c in plant.inputs], [c.high for c in plant.inputs]),
            (move, s.du_min, s.du_max),
        ):
            for i in range(n_u):
                for sign, limit in ((1, top), (-1, low)):
                    if limit is not None:
                        G.append(sign * row[i, :-1])
                        high.append(sign * (limit[i] - row[i, -1]))
        state = A @ state + B @ u(k)
        state[:, -1] += E @ rows(m.d, k)
        y = plant.C @ state + plant.D @ u(min(k + 1, s.N_p - 1))
        for sign, limit in ((1, s.y_max), (-1, s.y_min)):
            for i in range(n_y):
                if limit is not None and np.isfinite(limit[i]):
                    row = sign * y[i, :-1]
                    row[n_z - 1] -= softness[i]
                    G.append(row)
                    high.append(sign * (limit[i] - y[i, -1]))
        y[:, -1] -= rows(m.y_ref, k)
        H += y.T @ np.array(s.Q_y) @ y
        before = u(k)
    H[n_z - 1, n_z - 1] += s.Q_eps
    G.append(-np.eye(n_z)[-1])
    high.append(0.0)
    qp = QP(H[:-1, :-1], H[:-1, -1], np.array(G), np.full(len(G), -np.inf), np.array(high))
    solution = DAQPBackend().solve(qp)
    assert solution.solved
    return solution.z[:n_u], solution.z[-1]
