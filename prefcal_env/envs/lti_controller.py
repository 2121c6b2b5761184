"""Linear controllers: as a sampled control law, and closed around a plant without sampling."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_env.plants.systems import LinearPlant, LinearSystem

_SINGULAR = 1e12
"""Condition number from which on an algebraic loop is taken to have no solution."""


@dataclass(frozen=True, eq=False)
class Law:
    """A linear control law: x' = A x + B_r r + B_y y, u = C x + D_r r + D_y y."""

    A: Float[np.ndarray, "n_c n_c"]  # dynamics, shape (n_c, n_c)
    B_r: Float[np.ndarray, "n_c n_y"]  # effect of the references, shape (n_c, n_y)
    B_y: Float[np.ndarray, "n_c n_y"]  # effect of the outputs, shape (n_c, n_y)
    C: Float[np.ndarray, "n_u n_c"]  # inputs of the plant from states, shape (n_u, n_c)
    D_r: Float[np.ndarray, "n_u n_y"]  # inputs of the plant from references, shape (n_u, n_y)
    D_y: Float[np.ndarray, "n_u n_y"]  # inputs of the plant from outputs, shape (n_u, n_y)
    dt: float  # sample time; 0 if it is continuous

    def sampled(self, T_s: float) -> "Law":
        """Return a continuous law for a sampling time, by the trapezoidal (Tustin) rule."""
        if self.dt:
            return self
        one, h = np.eye(len(self.A)), T_s / 2
        inverse = np.linalg.inv(one - h * self.A)
        C = self.C @ inverse
        return Law(
            inverse @ (one + h * self.A),
            2 * h * inverse @ self.B_r,
            2 * h * inverse @ self.B_y,
            C,
            self.D_r + h * C @ self.B_r,
            self.D_y + h * C @ self.B_y,
            T_s,
        )


def law_of(system: LinearSystem, n_y: int, n_u: int, free: Bool[np.ndarray, " n_y"]) -> Law:
    """Return a controller that acts on r - y, or on r and y, as a law.

    Args:
        system: Controller with n_y inputs, the errors r - y, or 2 n_y, first r and then y.
        n_y: Number of outputs of the plant.
        n_u: Number of inputs of the plant.
        free: Whether an output has no reference; then r = y, shape (n_y,).

    Raises:
        SettingsError: If the controller has another number of inputs or outputs.
    """
    _, n_in, n_out = system.sizes
    if n_in not in (n_y, 2 * n_y) or n_out != n_u:
        raise SettingsError(
            f"a controller of {n_u} inputs and {n_y} outputs of the plant needs {n_u} outputs, and "
            f"{n_y} inputs (errors r - y) or {2 * n_y} (references r, then outputs y); "
            f"this one has {n_out} outputs and {n_in} inputs"
        )
    B_r, D_r = system.B[:, :n_y].copy(), system.D[:, :n_y].copy()
    B_y, D_y = (-B_r, -D_r) if n_in == n_y else (system.B[:, n_y:].copy(), system.D[:, n_y:].copy())
    B_y[:, free] += B_r[:, free]
    D_y[:, free] += D_r[:, free]
    B_r[:, free] = D_r[:, free] = 0.0
    return Law(system.A, B_r, B_y, system.C, D_r, D_y, system.dt)


class LTIController:
    """A sampled linear control law as a `Controller`. It acts on `Measurement.y`."""

    def __init__(self, law: Law) -> None:
        self._law, self._x = law, np.zeros(len(law.A))

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self._law.dt

    def move(self, measurement: Measurement) -> Move:
        """Return the input for the next period, and update the states."""
        law, x, y = self._law, self._x, measurement.y
        r = np.where(np.isnan(measurement.y_ref), 0.0, measurement.y_ref)
        u = law.C @ x + law.D_r @ r + law.D_y @ y
        self._x = law.A @ x + law.B_r @ r + law.B_y @ y
        return Move(u)


@dataclass(frozen=True, eq=False)
class Closed:
    """A closed loop: z' = A z + B w, (y, u) = C z + D w with w = (r, d)."""

    A: Float[np.ndarray, "n_z n_z"]
    B: Float[np.ndarray, "n_z n_w"]
    C: Float[np.ndarray, "n_o n_z"]
    D: Float[np.ndarray, "n_o n_w"]

    def run(
        self, z: Float[np.ndarray, " n_z"], w: Float[np.ndarray, "K n_w"], step: float
    ) -> tuple[Float[np.ndarray, "K n_z"], Float[np.ndarray, "K n_o"]]:
        """Return z and (y, u) at K instants, `step` apart, with w held in between: exact."""
        from scipy.linalg import expm  # takes a while to import

        n = len(z)
        full = np.zeros((n + w.shape[1], n + w.shape[1]))
        full[:n, :n], full[:n, n:] = self.A, self.B
        states = np.empty((len(w), n))
        with np.errstate(all="ignore"):
            propagator = expm(full * step)[:n]
            for k in range(len(w)):
                states[k] = z
                z = propagator[:, :n] @ z + propagator[:, n:] @ w[k]
            return states, states @ self.C.T + w @ self.D.T


def closed_loop(plant: LinearPlant, law: Law) -> Closed:
    """Return the closed loop of a continuous plant and a continuous law.

    Raises:
        SettingsError: If both pass a jump on at once, so that no input solves the loop.
    """
    s, n_u, n_c = plant.system, len(plant.inputs), len(law.A)
    n_y, n_x = s.sizes[2], len(s.A)
    B_u, B_d, D_u, D_d = s.B[:, :n_u], s.B[:, n_u:], s.D[:, :n_u], s.D[:, n_u:]
    loop = np.eye(n_u) - law.D_y @ D_u
    if np.linalg.cond(loop) > _SINGULAR:
        raise SettingsError(
            "this loop is algebraic and has no solution: plant and controller both pass a jump on "
            "at once, with a loop gain of 1; give the controller a filter"
        )
    # u = U z + V w
    U = np.linalg.solve(loop, np.hstack([law.D_y @ s.C, law.C]))
    V = np.linalg.solve(loop, np.hstack([law.D_r, law.D_y @ D_d]))
    y_z = np.hstack([s.C, np.zeros((n_y, n_c))]) + D_u @ U
    y_w = np.hstack([np.zeros((n_y, n_y)), D_d]) + D_u @ V
    from_d = np.hstack([np.zeros((n_x, n_y)), B_d])
    from_r = np.hstack([law.B_r, np.zeros((n_c, B_d.shape[1]))])
    A = np.vstack(
        [
            np.hstack([s.A, np.zeros((n_x, n_c))]) + B_u @ U,
            np.hstack([np.zeros((n_c, n_x)), law.A]) + law.B_y @ y_z,
        ]
    )
    B = np.vstack([B_u @ V + from_d, from_r + law.B_y @ y_w])
    return Closed(A, B, np.vstack([y_z, U]), np.vstack([y_w, V]))
