"""An extended Kalman filter, which estimates a plant's state from measurements."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant

from ._hold import discretize

_PIECES = 4
"""Pieces of a sampling period, each linearized in its middle, for strongly nonlinear plants."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """An estimated state with its uncertainty, in the plant's units.

    Args:
        mean: Mean, shape (n_x,).
        covariance: Covariance, shape (n_x, n_x), symmetric positive semidefinite.

    Raises:
        SettingsError: If the shapes do not fit each other.
    """

    mean: Float[np.ndarray, " n_x"]
    covariance: Float[np.ndarray, "n_x n_x"]

    def __post_init__(self) -> None:
        mean, P = np.array(self.mean, dtype=float), np.array(self.covariance, dtype=float)
        if mean.ndim != 1 or P.shape != (len(mean), len(mean)):
            raise SettingsError(
                "an estimate has a mean of shape (n,) and a covariance of shape (n, n), "
                f"got {mean.shape} and {P.shape}"
            )
        for name, array in (("mean", mean), ("covariance", P)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def finite(self) -> bool:
        """Whether all numbers are finite; a model that diverges makes the estimate unusable."""
        return bool(np.isfinite(self.mean).all() and np.isfinite(self.covariance).all())


class ExtendedKalmanFilter:
    """A filter for x⁺ = hold(x, u, d) + w, y = g(x, u, d) + v, with white noise w and v.

    The filter has no memory: it takes an `Estimate` and returns the next one. You provide the
    first one.

    Source: Anderson, Moore (1979), Optimal Filtering, section 8.2.
    Deviation: the mean follows the nonlinear hold exactly; the covariance its Jacobian, a product
    over pieces of the period. The update is in the form of Joseph, which keeps it symmetric and
    positive semidefinite.

    Args:
        plant: Plant that the filter uses as its model.
        T_s: Sampling time, in the plant's unit of time.
        Q: Covariance of w, the error of the model in one period, shape (n_x, n_x).
        R: Covariance of v, the measurement noise, shape (n_y, n_y), positive definite.

    Raises:
        SettingsError: If the sampling time is not positive or a covariance is not valid.
    """

    def __init__(
        self,
        plant: Plant,
        T_s: float,
        *,
        Q: Float[np.ndarray, "n_x n_x"],
        R: Float[np.ndarray, "n_y n_y"],
    ) -> None:
        if not 0 < T_s < np.inf:
            raise SettingsError(f"T_s must be positive and finite, got {T_s}")
        self.plant, self.T_s = plant, T_s
        self._Q = _covariance("Q", Q, len(plant.states))
        self._R = _covariance("R", R, len(plant.outputs))
        if np.linalg.eigvalsh(self._R)[0] <= 0:
            raise SettingsError("R must be positive definite: every output has some noise")
        # Middle and end of each piece.
        self._instants = np.arange(1, 2 * _PIECES + 1) * (T_s / (2 * _PIECES))

    def predict(
        self, estimate: Estimate, u: Float[np.ndarray, " n_u"], d: Float[np.ndarray, " n_d"]
    ) -> Estimate:
        """Return the estimate one period later, with u and d held, before the next measurement.

        It is not `finite` if the model diverges.
        """
        states = self.plant.hold(estimate.mean, u, d, self._instants)
        n = len(estimate.mean)
        if not np.isfinite(states).all():
            return Estimate(states[-1], np.full((n, n), np.inf))
        F, no_drift = np.eye(n), np.zeros(n)
        for middle in states[::2]:
            J = self.plant.jacobians(middle, u, d)
            F = discretize(J.A, J.B, no_drift, self.T_s / _PIECES)[0] @ F
        return Estimate(states[-1], F @ estimate.covariance @ F.T + self._Q)

    def update(
        self,
        estimate: Estimate,
        y: Float[np.ndarray, " n_y"],
        u: Float[np.ndarray, " n_u"],
        d: Float[np.ndarray, " n_d"],
    ) -> Estimate:
        """Return the estimate updated with the measured outputs `y`, shape (n_y,)."""
        x, P = estimate.mean, estimate.covariance
        C = self.plant.jacobians(x, u, d).C
        S = C @ P @ C.T + self._R
        K = np.linalg.solve(S, C @ P).T
        kept = np.eye(len(x)) - K @ C
        P = kept @ P @ kept.T + K @ self._R @ K.T
        return Estimate(x + K @ (y - self.plant.g(x, u, d)), (P + P.T) / 2)


def _covariance(name: str, value: object, n: int) -> Float[np.ndarray, "n n"]:
    matrix = np.array(value, dtype=float)
    if matrix.shape != (n, n) or not np.isfinite(matrix).all():
        raise SettingsError(f"{name} must be finite, shape ({n}, {n}), got {matrix.shape}")
    scale = max(float(np.abs(matrix).max()), 1e-300)
    if np.abs(matrix - matrix.T).max() > 1e-12 * scale:
        raise SettingsError(f"{name} must be symmetric, got {matrix.tolist()}")
    if np.linalg.eigvalsh(matrix)[0] < -1e-12 * scale:
        raise SettingsError(f"{name} must be positive semidefinite, got {matrix.tolist()}")
    return matrix
