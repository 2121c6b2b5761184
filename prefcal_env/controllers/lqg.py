"""A linear quadratic regulator that estimates the state from measured outputs."""

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from prefcal_env.arrays import vector
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems.matrices import held

from .linearized import Linearized
from .lqr import LQR, output
from .stored import as_data, storable


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
    return np.asarray((P + P.T) / 2)
