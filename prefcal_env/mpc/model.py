"""The prediction model of one MPC step: eq. mathcalS linearized and discretized, eq. MPCsys."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.plants.plant import Plant

from ._hold import discretize


@dataclass(frozen=True, slots=True)
class Prediction:
    """An affine model x⁺ = A[k] x + B[k] u + c[k] and y_k = C[k] x + D[k] u + e[k].

    x and u are relative to the present state and the last input; y is absolute. k runs from 0 to
    N_p - 1 for the states and from 0 to N_p for the outputs. An array with one entry is used for
    all k; e always has N_p + 1 rows.
    """

    A: Float[np.ndarray, "k n_x n_x"]
    B: Float[np.ndarray, "k n_x n_u"]
    c: Float[np.ndarray, "k_c n_x"]
    C: Float[np.ndarray, "k_y n_y n_x"]
    D: Float[np.ndarray, "k_y n_y n_u"]
    e: Float[np.ndarray, "N_p1 n_y"]


def at_point(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, "N n_d"],
    T_s: float,
    N_p: int,
) -> Prediction:
    """Return one model for the whole horizon, exact at (x, u): it keeps the term f(x, u, d).

    If d is a preview (rows for the coming steps, the last one is repeated), the affine terms
    follow each row; the Jacobians are those of the present.
    """
    J = plant.jacobians(x, u, d[0])
    steps = min(len(d), N_p)
    c = np.empty((steps, len(x)))
    for k in range(steps):
        A, B, c[k] = discretize(J.A, J.B, plant.f(x, u, d[k]), T_s)
    e = np.empty((N_p + 1, len(J.C)))
    e[:] = plant.g(x, u, d[0])
    for k in range(1, len(d)):
        e[k:] = plant.g(x, u, d[k])
    return Prediction(A[None], B[None], c, J.C[None], J.D[None], e)


def along_trajectory(
    plant: Plant,
    x: Float[np.ndarray, " n_x"],
    u_plan: Float[np.ndarray, "N_p n_u"],
    u_last: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, "N n_d"],
    T_s: float,
) -> Prediction:
    """Return the model of eq. MPCsys around the nominal trajectory of the inputs `u_plan`.

    If the nominal trajectory diverges, the last finite state is kept for the rest of the horizon,
    so that the model stays usable.
    """
    N_p, n_x, n_u = len(u_plan), len(x), len(u_last)
    A, B, c = np.empty((N_p, n_x, n_x)), np.empty((N_p, n_x, n_u)), np.empty((N_p, n_x))
    C, D, e = [], [], []
    period, no_drift = np.array([T_s]), np.zeros(n_x)
    nominal = x
    for k in range(N_p + 1):
        u, d_k = u_plan[min(k, N_p - 1)], d[min(k, len(d) - 1)]
        J = plant.jacobians(nominal, u, d_k)
        shift = u - u_last
        if k < N_p:
            A[k], B[k], _ = discretize(J.A, J.B, no_drift, T_s)
            following = plant.hold(nominal, u, d_k, period)[0]
            if not np.all(np.isfinite(following)):
                following = nominal
            # x_{k+1} - x = A (x_k - x) + B (u - u_last) + c passes through the nominal points.
            c[k] = following - x - A[k] @ (nominal - x) - B[k] @ shift
        C.append(J.C)
        D.append(J.D)
        e.append(plant.g(nominal, u, d_k) - J.C @ (nominal - x) - J.D @ shift)
        if k < N_p:
            nominal = following
    return Prediction(A, B, c, np.array(C), np.array(D), np.array(e))
