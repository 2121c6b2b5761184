"""An extended Kalman filter, which estimates a plant's state from measurements."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import weights
from prefcal_env.errors import SettingsError
from prefcal_env.plants.disturbed import Disturbed
from prefcal_env.plants.jacobians import D, U, Y
from prefcal_env.plants.plant import Plant

from .kernels import filter as kernels

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
    first one. Of a `Disturbed` plant it also estimates the disturbances, which follow x.

    Source: Anderson, Moore (1979), Optimal Filtering, section 8.2.
    Deviation: the mean follows the nonlinear hold exactly; the covariance its Jacobian, a product
    over pieces of the period. The update is in the form of Joseph, which keeps it symmetric and
    positive semidefinite.

    Args:
        plant: Plant that the filter uses as its model.
        T_s: Sampling time, in the plant's unit of time.
        Q: Covariance of w, the error of the model in one period, shape (n, n); n is n_x, and for a
            `Disturbed` plant n_x plus the number of its disturbances.
        R: Covariance of v, the measurement noise, shape (n_y, n_y), positive definite.

    Raises:
        SettingsError: If the sampling time is not positive or a covariance is not valid.
    """

    def __init__(
        self, plant: Plant, T_s: float, *, Q: Float[np.ndarray, "n_x n_x"], R: Float[np.ndarray, "n_y n_y"]
    ) -> None:
        if not 0 < T_s < np.inf:
            raise SettingsError(f"T_s must be positive and finite, got {T_s}")
        self.plant, self.T_s = plant, T_s
        model = self._model = plant if isinstance(plant, Disturbed) else Disturbed(plant)
        self._n_x, n_y = len(plant.states), len(plant.outputs)
        self._Q = weights("Q", Q, self._n_x + len(model.offsets))
        self._R = weights("R", R, n_y, definite=True)  # every output has some noise
        # Middle and end of each piece.
        self._instants = np.arange(1, 2 * _PIECES + 1) * (T_s / (2 * _PIECES))

    def predict(self, estimate: Estimate, u: U, d: D) -> Estimate:
        """Return the estimate one period later, with u and d held, before the next measurement.

        It is not `finite` if the model diverges.
        """
        x, u, d = self._point(estimate, u, d)
        states = self._model.hold(x, u, d, self._instants)
        mean = np.concatenate([states[-1], estimate.mean[self._n_x :]])
        if not np.isfinite(states).all():
            return Estimate(mean, np.full_like(self._Q, np.inf))
        equations, middles = self._model.equations, np.ascontiguousarray(states[::2])
        covariance = kernels.carried(
            equations.packed,
            middles,
            u,
            d,
            estimate.covariance.copy(order="C"),
            self._Q,
            self.T_s / _PIECES,
            len(self._R),
        )
        equations.check()
        return Estimate(mean, covariance)

    def update(self, estimate: Estimate, y: Y, u: U, d: D) -> Estimate:
        """Return the estimate updated with the measured outputs `y`, shape (n_y,)."""
        equations, P = self._model.equations, estimate.covariance.copy(order="C")
        measured = np.array(y, dtype=float, order="C")
        point = self._point(estimate, u, d)
        mean, covariance = kernels.updated(equations.packed, *point, P, self._R, measured)
        equations.check()
        return Estimate(mean, covariance)

    def linearized(
        self, estimate: Estimate, u: U, d: D
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n_y n"]]:
        """Return A = ∂ẋ/∂(x, p, w) and C = ∂y/∂(x, p, w) at an estimate."""
        equations, point = self._model.equations, self._point(estimate, u, d)
        A, C = kernels.linearize(equations.packed, *point, len(self._R))
        equations.check()
        return A, C

    def _point(self, estimate: Estimate, u: U, d: D) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x, u, and d followed by the disturbances, as writable copies."""
        mean = estimate.mean
        u = np.array(u, dtype=float, order="C")
        return mean[: self._n_x].copy(), u, np.concatenate([d, mean[self._n_x :]], dtype=float)
