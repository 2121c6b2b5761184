"""State feedback by a linear quadratic regulator, with measured or estimated states."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from prefcal_env.arrays import is_number, matrix, vector, weights
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Measurement, Move
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import held

from .stored import as_data, finite, index_of, infinite, reference_of, storable


@dataclass(frozen=True, slots=True, eq=False)
class Linearized:
    """A model ẋ = A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0), with input limits.

    Args:
        A: Dynamics, per unit of time, shape (n_x, n_x).
        B: Effect of the inputs, shape (n_x, n_u).
        C: Outputs from states, shape (n_y, n_x).
        D: Outputs from inputs, shape (n_y, n_u).
        x0: State at rest, shape (n_x,).
        u0: Input at rest, shape (n_u,).
        y0: Output at rest, shape (n_y,).
        low: Lower limits of the inputs, shape (n_u,).
        high: Upper limits of the inputs, shape (n_u,).

    Raises:
        SettingsError: If the shapes do not fit each other, or a number but a limit is not finite.
    """

    A: Float[np.ndarray, "n_x n_x"]
    B: Float[np.ndarray, "n_x n_u"]
    C: Float[np.ndarray, "n_y n_x"]
    D: Float[np.ndarray, "n_y n_u"]
    x0: Float[np.ndarray, " n_x"]
    u0: Float[np.ndarray, " n_u"]
    y0: Float[np.ndarray, " n_y"]
    low: Float[np.ndarray, " n_u"]
    high: Float[np.ndarray, " n_u"]

    def __post_init__(self) -> None:
        n_x, n_u, n_y = np.size(self.x0), np.size(self.u0), np.size(self.y0)
        matrices = (n_x, n_x), (n_x, n_u), (n_y, n_x), (n_y, n_u)
        vectors = (n_x,), (n_u,), (n_y,), (n_u,), (n_u,)
        for field, shape in zip(fields(self), (*matrices, *vectors), strict=True):
            name = field.name
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape:
                raise SettingsError(f"{name} must have shape {shape}, got {array.shape}")
            limit = name in ("low", "high")
            if np.isnan(array).any() or (not limit and np.isinf(array).any()):
                raise SettingsError(f"{name} must be finite, got {array.tolist()}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)


def linearized(plant: Plant, x0: Any, u0: Any, d0: Any, T_s: float) -> Linearized:
    """Return the model of `plant` at a steady state; None means zeros.

    Args:
        plant: Plant; its dead time is left out.
        x0: State at rest, shape (n_x,).
        u0: Input at rest, shape (n_u,).
        d0: Measured disturbances at rest, shape (n_d,).
        T_s: Time within which the plant must hardly move, in its unit of time.

    Raises:
        SettingsError: If the plant does not rest there.
    """
    x, u, d = (
        vector(name, np.zeros(len(channels)) if value is None else value, len(channels), "finite")
        for name, value, channels in (
            ("x0", x0, plant.states),
            ("u0", u0, plant.inputs),
            ("d0", d0, plant.disturbances),
        )
    )
    rate = np.asarray(plant.f(x, u, d), dtype=float)
    # At rest, it moves in a sampling period by at most a millionth of the size of the state.
    if not np.abs(rate).max(initial=0.0) * T_s <= 1e-6 * (1 + np.abs(x).max(initial=0.0)):
        raise SettingsError(
            f"plant {plant.name!r} does not rest at x0={x.tolist()}, u0={u.tolist()}: its state "
            f"changes by {rate.tolist()} per {plant.time_unit}; give a steady state"
        )
    J = plant.jacobians(x, u, d)
    low, high = (np.array([getattr(c, k) for c in plant.inputs]) for k in ("low", "high"))
    return Linearized(J.A, J.B, J.C, J.D, x, u, np.asarray(plant.g(x, u, d)), low, high)


@storable
class LQR:
    """A state feedback that minimizes Σ x'Qx + u'Ru of the plant linearized at a steady state.

    Without integral action, u = u_r - K (x - x_r), limited, where (x_r, u_r) is the state of rest
    at which the outputs reach their references (least squares if there is none); references that
    are NaN do not matter. With it, u = u0 - K (x - x0) - K_i q, where q sums T_s (y - r) of the
    outputs in `integral` and is weighted by Q_i; these have no offset, even if the model is wrong.

    Anti-windup is conditional integration: while an input is at a limit, q moves only if that
    brings the input back.

    Source: Åström, Wittenmark (1997), Computer-Controlled Systems (sampled linear quadratic
    control); Franklin, Powell, Workman (1998), Digital Control of Dynamic Systems (integral
    action); Åström, Hägglund (2006), Advanced PID Control (conditional integration).
    Deviation: the cost is summed at sampling instants, as `control.dlqr` does.

    Args:
        plant: Plant, or its `Linearized` model. Its dead time is left out.
        Q: Weights of the states, shape (n_x,) for a diagonal or (n_x, n_x), at least 0.
        R: Weights of the inputs, shape (n_u,) or (n_u, n_u), above 0.
        T_s: Sampling time, in the plant's unit of time.
        x0: State of the steady state at which the plant is linearized; None for zeros.
        u0: Its input; None for zeros.
        d0: Its measured disturbances; None for zeros.
        integral: Outputs with integral action, by index or, with a plant, by name.
        Q_i: Weights of their integrated errors, shape (n_i,) or (n_i, n_i), above 0; a large one
            removes errors fast.

    Raises:
        SettingsError: If the plant does not rest there, a weight is not valid, or no feedback
            stabilizes the plant.
    """

    def __init__(
        self,
        plant: Plant | Linearized,
        Q: Any,
        R: Any,
        *,
        T_s: float,
        x0: Any = None,
        u0: Any = None,
        d0: Any = None,
        integral: Sequence[int | str] = (),
        Q_i: Any = (),
    ) -> None:
        if not is_number(T_s) or not 0 < T_s < np.inf:
            raise SettingsError(f"T_s must be above 0 and finite, got {T_s}")
        channels = None if isinstance(plant, Linearized) else plant.outputs
        m = plant if isinstance(plant, Linearized) else linearized(plant, x0, u0, d0, T_s)
        self.model = m
        self._T_s = float(T_s)
        self.Q = weights("Q", Q, len(m.x0))
        self.R = weights("R", R, len(m.u0), definite=True)
        self.integral = tuple(index_of(i, channels, "output") for i in integral)
        self.Q_i = weights("Q_i", Q_i, len(self.integral), definite=True)
        if any(i >= len(m.y0) for i in self.integral) or np.any(m.D[list(self.integral)]):
            raise SettingsError(
                f"integral must name outputs that inputs reach through states only, got {integral}"
            )
        self._A, self._B = held(m.A, m.B, self._T_s)
        gain = self._gain()
        self.K, self.K_i = gain[:, : len(m.x0)], gain[:, len(m.x0) :]
        self._sum = np.zeros(len(self.integral))

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self._T_s

    @property
    def K_r(self) -> Float[np.ndarray, "n_u n_y"]:
        """Gain of the references without integral action: u = u0 + K_r (r - y0) - K (x - x0), limited.

        It holds if every output has a reference.
        """
        at_rest = [self._rest(self.model.y0 + unit) for unit in np.eye(len(self.model.y0))]
        return np.column_stack([u_r + self.K @ x_r for x_r, u_r in at_rest])

    def as_data(self) -> dict[str, Any]:
        """Return model and weights as JSON-able data; None for infinite limits."""
        model = {f.name: getattr(self.model, f.name).tolist() for f in fields(Linearized)}
        for name in ("low", "high"):
            # JSON has no infinity.
            model[name] = [finite(limit) for limit in model[name]]
        weights = {name: getattr(self, name).tolist() for name in ("Q", "R", "Q_i")}
        return {"model": model, "T_s": self.T_s, "integral": list(self.integral), **weights}

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the LQR that `as_data` describes. Raises SettingsError or KeyError for other data."""
        model = dict(data["model"])
        n_x, n_u, n_y = (len(model[name]) for name in ("x0", "u0", "y0"))
        for name in ("low", "high"):
            model[name] = [infinite(name, value) for value in model[name]]
        for name, shape in {"A": (n_x, n_x), "B": (n_x, n_u), "C": (n_y, n_x)}.items():
            model[name] = matrix(name, model[name], shape)
        integral = data["integral"]
        Q_i = matrix("Q_i", data["Q_i"], (len(integral),) * 2)
        return cls(Linearized(**model), data["Q"], data["R"], T_s=data["T_s"], integral=integral, Q_i=Q_i)

    def move(self, measurement: Measurement) -> Move:
        """Decide the inputs from the measured state."""
        return self.decide(measurement, measurement.x)

    def decide(self, measurement: Measurement, x: Float[np.ndarray, " n_x"]) -> Move:
        """Decide the inputs from a state that was measured or estimated."""
        m, r = self.model, reference_of(measurement)
        dx = np.asarray(x, dtype=float) - m.x0
        if self.integral:
            error = output(m, measurement)[list(self.integral)] - r[list(self.integral)]
            # An output without a reference (NaN) has no error to sum.
            step = self._T_s * np.nan_to_num(error)
            v = m.u0 - self.K @ dx - self.K_i @ self._sum
            # As in the design, the error of this instant counts from the next one on.
            u = np.clip(v, m.low, m.high)
            # Conditional integration: at a limit the sum moves only if that moves v back toward u.
            if not np.any(v - u) or float((v - u) @ (self.K_i @ step)) > 0:
                self._sum = self._sum + step
        else:
            x_r, u_r = self._rest(r)
            u = np.clip(m.u0 + u_r - self.K @ (dx - x_r), m.low, m.high)
        return Move(u)

    def _gain(self) -> Float[np.ndarray, "n_u n"]:
        """Return [K, K_i] of the model, extended by the sums of errors."""
        m, n_i = self.model, len(self.integral)
        n = len(m.x0)
        A, B = np.eye(n + n_i), np.zeros((n + n_i, len(m.u0)))
        A[:n, :n], B[:n] = self._A, self._B
        # The sums are states, too: q⁺ = q + T_s (y - r), of which the model knows y.
        A[n:, :n] = self._T_s * m.C[list(self.integral)]
        Q = np.zeros_like(A)
        Q[:n, :n], Q[n:, n:] = self.Q, self.Q_i
        try:
            P = solve_discrete_are(A, B, Q, self.R)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise _unstable(self.integral) from error
        K = np.asarray(np.linalg.solve(self.R + B.T @ P @ B, B.T @ P @ A))
        # What the solver returns need not stabilize, where a state that does not decay has no weight.
        if not np.abs(np.linalg.eigvals(A - B @ K)).max(initial=0.0) < 1 - 1e-12:
            raise _unstable(self.integral)
        return K

    def _rest(self, r: Float[np.ndarray, " n_y"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the state of rest, as deviations, at which the outputs are at r."""
        m, n = self.model, len(self.model.x0)
        # An output without a reference may rest anywhere: it gives no equation.
        asked = np.flatnonzero(np.isfinite(r))
        rows = np.block([[m.A, m.B], [m.C[asked], m.D[asked]]])
        sizes = np.concatenate([np.zeros(n), r[asked] - m.y0[asked]])
        # Of many states of rest the smallest; of none the one with the least error.
        found = np.linalg.lstsq(rows, sizes, rcond=None)[0]
        return found[:n], found[n:]


def output(m: Linearized, measurement: Measurement) -> Float[np.ndarray, " n_y"]:
    """Return the measured outputs, or, if none were measured, those of the measured state."""
    if len(measurement.y):
        return np.asarray(measurement.y, dtype=float)
    return np.asarray(m.y0 + m.C @ (measurement.x - m.x0) + m.D @ (measurement.u - m.u0))


def _unstable(integral: tuple[int, ...]) -> SettingsError:
    more = f", or use fewer outputs in integral={list(integral)}" if integral else ""
    return SettingsError(
        "no state feedback with these weights stabilizes the linearized plant: weight every state "
        f"that does not decay by itself with Q above 0{more}"
    )


@storable
class LQG:
    """An `LQR` with a Kalman filter: it reads measured outputs, and never the plant's state.

    The filter starts at the steady state with the covariance that it has in the long run, so its
    gain is constant. A constant load shifts the estimates: let the LQR have integral action.

    Source: Åström, Wittenmark (1997), Computer-Controlled Systems.

    Args:
        lqr: State feedback, which also holds the model.
        noise: Standard deviation of the measured outputs, in their units, above 0, shape (n_y,).
        process: Error of the model over one unit of time, in the states' units, shape (n_x,). It
            grows with the square root of time.

    Raises:
        SettingsError: If a deviation is not valid, or the outputs do not tell the state.
    """

    def __init__(self, lqr: LQR, noise: Sequence[float], process: Sequence[float]) -> None:
        # Here, since the filter loads a compiler.
        from prefcal_env.mpc.estimator import ExtendedKalmanFilter, StateEstimate

        self.lqr, m = lqr, lqr.model
        self.noise = vector("noise", noise, len(m.y0), "above 0")
        self.process = vector("process", process, len(m.x0), "at least 0")
        Q, R = np.diag(self.process**2) * lqr.T_s, np.diag(self.noise**2)
        plant = Plant.of((m.A, m.B, m.C, m.D))  # deviations from the steady state
        self._filter = ExtendedKalmanFilter(plant, lqr.T_s, Q=Q, R=R)
        # With the covariance of the long run at the start, the gain is the same at every step.
        self._start = StateEstimate(np.zeros(len(m.x0)), _lasting(m, lqr.T_s, Q, R))
        self._estimate: StateEstimate | None = None

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self.lqr.T_s

    @property
    def estimate(self) -> Float[np.ndarray, " n_x"] | None:
        """State as estimated at the last measurement, shape (n_x,); None before the first."""
        return None if self._estimate is None else self.lqr.model.x0 + self._estimate.mean

    @property
    def gain(self) -> Float[np.ndarray, "n_x n_y"]:
        """Gain of the Kalman filter, from the error of the predicted outputs to the estimate."""
        C, P = self.lqr.model.C, self._start.covariance
        return np.asarray(np.linalg.solve(C @ P @ C.T + np.diag(self.noise**2), C @ P).T)

    def as_data(self) -> dict[str, Any]:
        """Return regulator and deviations as JSON-able data."""
        deviations = {"noise": self.noise.tolist(), "process": self.process.tolist()}
        return {"lqr": as_data(self.lqr), **deviations}

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the LQG that `as_data` describes. Raises SettingsError or KeyError for other data."""
        return cls(LQR.of_data(data["lqr"]), data["noise"], data["process"])

    def move(self, measurement: Measurement) -> Move:
        """Estimate the state from the measured outputs, then decide the inputs."""
        m, none = self.lqr.model, np.zeros(0)
        u = np.asarray(measurement.u, dtype=float) - m.u0
        predicted = self._start
        if self._estimate is not None:
            predicted = self._filter.predict(self._estimate, u, none)
            # The model of an unstable loop blows up: then the filter starts anew rather than stay NaN.
            predicted = predicted if predicted.finite else self._start
        y = output(m, measurement) - m.y0
        self._estimate = self._filter.update(predicted, y, u, none)
        return self.lqr.decide(measurement, m.x0 + self._estimate.mean)


def _lasting(m: Linearized, T_s: float, Q: np.ndarray, R: np.ndarray) -> Float[np.ndarray, "n n"]:
    """Return the covariance of the predicted state in the long run."""
    A = held(m.A, m.B, T_s)[0]
    try:
        P = np.asarray(solve_discrete_are(A.T, m.C.T, Q, R))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise SettingsError(
            "the outputs do not tell the plant's state: measure more of them, or give every state "
            "that does not decay by itself a process deviation above 0"
        ) from error
    # The filter assumes a symmetric covariance; the solver's is so only up to rounding.
    return np.asarray((P + P.T) / 2)
