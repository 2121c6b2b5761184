"""The linear (time-varying) model predictive controller of eq. MPC and eq. MPC_constraints."""

from collections.abc import Iterator
from math import isfinite

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_env.plants.plant import Plant
from prefcal_env.qp import QP, make_backend

from . import _plan
from .limits import Limits
from .model import Prediction, along_trajectory, at_point
from .settings import MPCSettings

_SMALLEST_MOVE_WEIGHT = 1e-10


class LinearMPC:
    """The MPC of eq. MPC: linearize, condense to a QP, solve, apply the first input.

    Each step solves for deviations v from the unconstrained optimal feedback (see `_riccati`),
    which is eq. MPC in other variables. It weighs the outputs y_1 ... y_Np and the inputs and moves
    0 ... N_p - 1.

    Deviation: eq. MPC weighs y_0 ... y_Np-1; y_0 is already measured, and weighing it has no effect
    (without D). Eq. MPC_constraints limits inputs and moves from k = 1 on, which leaves the one
    that is applied without a limit. It holds the inputs from u_Nu on, so that N_u + 1 moves are
    free, while the minimum is over N_u of them; here N_u are. All measured in docs/deviations.md.

    Deviation: if Q_u + Q_Δu is singular, 1e-10 of the largest weight is added to Q_Δu, since
    eq. MPC may then have no unique minimizer.

    Args:
        plant: Plant that the controller uses as its model.
        settings: Horizons, weights and limits.

    Raises:
        SettingsError: If the shapes of weights or limits do not fit the plant.
    """

    def __init__(self, plant: Plant, settings: MPCSettings) -> None:
        self.plant, self.settings = plant, settings
        n_u, n_y = len(plant.inputs), len(plant.outputs)
        Q_u = _weight("Q_u", settings.Q_u, n_u)
        Q_y, Q_du = _weight("Q_y", settings.Q_y, n_y), _weight("Q_du", settings.Q_du, n_u)
        floor = _SMALLEST_MOVE_WEIGHT * max(Q_y.max(), Q_u.max(), Q_du.max())
        if floor <= 0:
            raise SettingsError("Q_y, Q_u and Q_du must not all be zero: there is nothing to weigh")
        if np.linalg.eigvalsh(Q_u + Q_du)[0] < floor:
            Q_du = Q_du + floor * np.eye(n_u)
        self._roots = (_root(Q_y), _root(Q_u), _root(Q_du))
        self._u_ref = _rows("u_ref", settings.u_ref, n_u)
        self._limits = Limits.of(plant, settings)
        self._sizes = len(plant.states), n_u, n_y, len(plant.disturbances)
        self._backend = make_backend(settings.backend, settings.tolerances)
        n = settings.N_u * n_u + (1 if self._limits.soft else 0)
        self._cost = QP(np.eye(n), np.zeros(n), np.zeros((0, n)), np.zeros(0), np.zeros(0))
        self._plan: Float[np.ndarray, "N_p n_u"] | None = None

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self.settings.T_s

    def forget(self) -> None:
        """Drop the last plan, used by linearization "trajectory": the task has changed."""
        self._plan = None

    def move(self, measurement: Measurement) -> Move:
        """Decide the next input; hold the last one if the QP is not solved.

        Deviations v are the right variables as long as the limits leave room to control the
        growing modes of the model. If they do not, no plan stabilizes the model and v is as large
        as its growth; then the first problem is not solved, and the second one is tried, with the
        inputs themselves as variables.

        Raises:
            PlantError: If a measurement has the wrong shape or is not finite.
        """
        self._check(measurement)
        iterations = 0
        for qp, U in self.problems(measurement):
            solution = self._backend.solve(qp)
            iterations += solution.iterations
            if solution.solved:
                u = measurement.u.copy()
                self._plan = _plan.inputs(U, solution.z, u, qp.lower, qp.upper)
                return Move(self._plan[0], iterations)
        self._plan = None
        return Move(measurement.u, iterations, solved=False)

    def problems(self, m: Measurement) -> Iterator[tuple[QP, Float[np.ndarray, "N_u n_u n_v1"]]]:
        """Yield the QP of one step, first in deviations and then in inputs.

        Yields:
            The QP in its variables (then the slack), and U, shape (N_u, n_u, n_v + 1): the inputs
            relative to the last one as affine functions of the variables, the last column
            constant. Nothing if limited outputs grow beyond what can be trusted.
        """
        s, limits = self.settings, self._limits
        model = self._predict(m)
        dynamics = model.A, model.B, model.c
        N_y = s.N_p if limits.soft else 0
        # Copied because a measurement's array may be read-only: another type, compiled again.
        u = m.u.copy()
        R, U, X, unit, rows = _plan.condense(
            *dynamics, model.C, model.D, model.e - self._references(m.y_ref),
            self._roots, self._u_ref - u, s.N_u, N_y, u, limits.hard,
        )  # fmt: skip
        if limits.trusted(X):
            yield self._cost.under(*limits.rows(rows, model, U, X, unit)), U
        U, X, T = _plan.open_loop(*dynamics, R, N_y)
        if not limits.trusted(X):
            return
        unit = float(np.abs(T).max())
        T = T / unit
        P, q = self._cost.P.copy(), self._cost.q.copy()
        n_v = len(T)
        P[:n_v, :n_v], q[:n_v] = T[:, :-1].T @ T[:, :-1], T[:, :-1].T @ T[:, -1]
        rows = _plan.input_rows(U, u, *limits.hard)
        yield QP(P, q, *limits.rows(rows, model, U, X, unit)), U

    def _check(self, m: Measurement) -> None:
        n_x, n_u, n_y, n_d = self._sizes
        for name, array, shape, rows in (
            ("x", m.x, (n_x,), False),
            ("u", m.u, (n_u,), False),
            ("d", m.d, (n_d,), True),
            ("y_ref", m.y_ref, (n_y,), True),
        ):
            found = np.shape(array)
            previewed = rows and len(found) == 2 and found[0] > 0 and found[1:] == shape
            if not (isinstance(array, np.ndarray) and (found == shape or previewed)):
                raise PlantError(
                    f"measurement: {name} must be an array of shape {shape}"
                    f"{', or one row a step' if rows else ''}, got {array!r}"
                )
            if not isfinite(array.sum()):
                raise PlantError(f"measurement: {name} must be finite, got {array}")

    def _predict(self, m: Measurement) -> Prediction:
        s = self.settings
        d = m.d if m.d.ndim == 2 else m.d[None]
        if s.linearization == "point":
            return at_point(self.plant, m.x, m.u, d, s.T_s, s.N_p)
        plan = np.tile(m.u, (s.N_p, 1))
        if self._plan is not None:  # shift the last plan by one step and hold its last input
            shifted = self._plan[1:]
            plan[: len(shifted)] = shifted
            plan[len(shifted) :] = self._plan[-1]
        return along_trajectory(self.plant, m.x, plan, m.u, d, s.T_s)

    def _references(self, y_ref: Float[np.ndarray, "*y"]) -> Float[np.ndarray, "*rows"]:
        """Return rows for y_0 ... y_Np; a preview starts at y_1, and its last row is repeated."""
        if y_ref.ndim == 1:
            return y_ref
        rows = np.minimum(np.arange(-1, self.settings.N_p), len(y_ref) - 1)
        return np.asarray(y_ref[np.maximum(rows, 0)])


def _weight(name: str, Q: object, n: int) -> Float[np.ndarray, "n n"]:
    matrix = np.zeros((n, n)) if Q is None else np.array(Q, dtype=float)
    if matrix.shape != (n, n):
        raise SettingsError(f"{name} must have shape ({n}, {n}), got {matrix.shape}")
    return matrix


def _root(Q: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "r n"]:
    """Return rows L with LᵀL = Q, as many as the rank of Q."""
    values, vectors = np.linalg.eigh(Q)
    kept = values > 1e-14 * max(values.max(), 0.0)
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T)


def _rows(name: str, value: object, n: int) -> Float[np.ndarray, "k n"]:
    rows = np.zeros((1, n)) if value is None else np.atleast_2d(np.array(value, dtype=float))
    if rows.ndim != 2 or rows.shape[1] != n or not np.all(np.isfinite(rows)):
        raise SettingsError(f"{name} must be finite, shape ({n},) or (N, {n}), got {value!r}")
    return rows
