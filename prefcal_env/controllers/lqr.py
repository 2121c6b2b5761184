"""State feedback by a linear quadratic regulator, sampled, with integral action if wanted."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Self

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from prefcal_env.arrays import weights
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_env.knobs.knob import is_number
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems.matrices import held

from .linearized import Linearized, linearized
from .measured import index_of, reference_of
from .stored import finite, infinite, storable


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

    def as_data(self) -> dict[str, Any]:
        """Return model and weights as JSON-able data; None for infinite limits."""
        model = {f.name: getattr(self.model, f.name).tolist() for f in fields(Linearized)}
        for name in ("low", "high"):
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
        # Lists without rows have no columns.
        for name, shape in {"A": (n_x, n_x), "B": (n_x, n_u), "C": (n_y, n_x)}.items():
            model[name] = np.reshape(model[name], shape)
        integral = data["integral"]
        Q_i = np.reshape(data["Q_i"], (len(integral),) * 2)
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
            step = self._T_s * np.nan_to_num(error)
            v = m.u0 - self.K @ dx - self.K_i @ self._sum
            # As in the design, the error of this instant counts from the next one on.
            u = np.clip(v, m.low, m.high)
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
        A[n:, :n] = self._T_s * m.C[list(self.integral)]
        Q = np.zeros_like(A)
        Q[:n, :n], Q[n:, n:] = self.Q, self.Q_i
        try:
            P = solve_discrete_are(A, B, Q, self.R)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise _unstable(self.integral) from error
        K = np.asarray(np.linalg.solve(self.R + B.T @ P @ B, B.T @ P @ A))
        if not np.abs(np.linalg.eigvals(A - B @ K)).max(initial=0.0) < 1 - 1e-12:
            raise _unstable(self.integral)
        return K

    def _rest(self, r: Float[np.ndarray, " n_y"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the state of rest, as deviations, at which the outputs are at r."""
        m, n = self.model, len(self.model.x0)
        asked = np.flatnonzero(np.isfinite(r))
        rows = np.block([[m.A, m.B], [m.C[asked], m.D[asked]]])
        sizes = np.concatenate([np.zeros(n), r[asked] - m.y0[asked]])
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
