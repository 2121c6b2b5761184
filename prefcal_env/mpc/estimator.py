"""Estimate states and disturbances by an extended Kalman filter, for an MPC without offset."""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import vector, weights
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Measurement, Move
from prefcal_env.plants.jacobians import D, U, Y
from prefcal_env.plants.plant import Disturbed, Plant

from . import kernels
from .controller import LinearMPC, MPCSettings

_PIECES = 4  # pieces of a sampling period, each linearized in its middle, for strongly nonlinear plants


@dataclass(frozen=True, slots=True, eq=False)
class StateEstimate:
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

    The filter has no memory: it takes a `StateEstimate` and returns the next one. You provide the
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
        # Without disturbances of its own, `Disturbed` is the plant itself: then one code serves both.
        model = self._model = plant if isinstance(plant, Disturbed) else Disturbed(plant)
        self._n_x, n_y = len(plant.states), len(plant.outputs)
        self._Q = weights("Q", Q, self._n_x + len(model.offsets))
        self._R = weights("R", R, n_y, definite=True)  # every output has some noise
        # Middle and end of each piece.
        self._instants = np.arange(1, 2 * _PIECES + 1) * (T_s / (2 * _PIECES))

    def predict(self, estimate: StateEstimate, u: U, d: D) -> StateEstimate:
        """Return the estimate one period later, with u and d held, before the next measurement.

        It is not `finite` if the model diverges.
        """
        x, u, d = self._point(estimate, u, d)
        states = self._model.hold(x, u, d, self._instants)
        # p⁺ = p and w⁺ = w: disturbances integrate noise alone, so their mean stays.
        mean = np.concatenate([states[-1], estimate.mean[self._n_x :]])
        if not np.isfinite(states).all():
            return StateEstimate(mean, np.full_like(self._Q, np.inf))
        # The Jacobian at the middle of each piece: a midpoint rule, of second order in its length.
        equations, middles = self._model.equations, np.ascontiguousarray(states[::2])
        # A copy: frozen arrays are of another type, for which numba would compile again.
        P, T = estimate.covariance.copy(order="C"), self.T_s / _PIECES
        covariance = kernels.carried(equations.packed, middles, u, d, P, self._Q, T, len(self._R))
        equations.check()
        return StateEstimate(mean, covariance)

    def update(self, estimate: StateEstimate, y: Y, u: U, d: D) -> StateEstimate:
        """Return the estimate updated with the measured outputs `y`, shape (n_y,)."""
        equations, P = self._model.equations, estimate.covariance.copy(order="C")
        measured = np.array(y, dtype=float, order="C")
        point = self._point(estimate, u, d)
        mean, covariance = kernels.updated(equations.packed, *point, P, self._R, measured)
        equations.check()
        return StateEstimate(mean, covariance)

    def linearized(
        self, estimate: StateEstimate, u: U, d: D
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n_y n"]]:
        """Return A = ∂ẋ/∂(x, p, w) and C = ∂y/∂(x, p, w) at an estimate."""
        equations, point = self._model.equations, self._point(estimate, u, d)
        A, C = kernels.linearize(equations.packed, *point, len(self._R))
        equations.check()
        return A, C

    def _point(self, estimate: StateEstimate, u: U, d: D) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x, u, and d followed by the disturbances, as writable copies."""
        mean = estimate.mean
        u = np.array(u, dtype=float, order="C")
        return mean[: self._n_x].copy(), u, np.concatenate([d, mean[self._n_x :]], dtype=float)


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """Settings of a `DisturbanceEstimator`, as standard deviations. Sequences become tuples.

    Args:
        noise: Noise of the measured outputs, in their units, above 0, shape (n_y,).
        process: Error of the model over one unit of time, in the states' units, shape (n_x,). It
            grows with the square root of time, so different T_s can share it.
        drift: Change of the disturbances over one unit of time, first of outputs and then of
            inputs, in their units, above 0, shape (n_p + n_w,). Small values are slow and calm.
        start: Error of the first measured state, in the states' units, shape (n_x,); None uses
            `process`.
        on_outputs: Indices of the outputs with an integrating disturbance.
        on_inputs: Indices of the inputs with an integrating disturbance.

    Raises:
        SettingsError: If a deviation is negative or not finite, or 0 where it must be above 0.
    """

    noise: tuple[float, ...]
    process: tuple[float, ...]
    drift: tuple[float, ...] = ()
    start: tuple[float, ...] | None = None
    on_outputs: tuple[int, ...] = ()
    on_inputs: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None:
                object.__setattr__(self, field.name, tuple(value))
        for name in ("noise", "process", "drift", "start"):
            value = getattr(self, name) or ()
            above = name in ("noise", "drift")
            vector(f"estimator: {name}", value, len(value), "above 0" if above else "at least 0")


class DisturbanceEstimator:
    """An estimator of state and integrating disturbances, updated with each measurement.

    This is an extended Kalman filter of the plant augmented by p⁺ = p and w⁺ = w. With as many
    disturbances as outputs, measured and predicted outputs agree at rest, so that an MPC that uses
    the estimates has no offset.

    The plant determines which disturbances can be distinguished from the state: not the p of an
    output that integrates by itself (a car's position); in that case use w of the inputs.

    Source: Pannocchia, Rawlings (2003), Disturbance models for offset-free MPC, AIChE J. 49,
    equation (1) and the rank condition of Lemma 1, checked at the first measurement.
    Deviation: nonlinear, by an extended Kalman filter.

    Args:
        plant: Plant that the estimator uses as its model.
        settings: Standard deviations that say how far to trust model and measurements.
        T_s: Sampling time, in the plant's unit of time.

    Raises:
        SettingsError: If the settings do not fit the plant, or there are more disturbances than
            outputs.
    """

    def __init__(self, plant: Plant, settings: EstimatorSettings, T_s: float) -> None:
        s = settings
        self.model = Disturbed(plant, s.on_outputs, s.on_inputs)
        n_x, n_y, n_o = len(plant.states), len(plant.outputs), len(self.model.offsets)
        # With more, even data without noise could be explained in several ways (Pannocchia, Rawlings).
        if n_o > n_y:
            raise SettingsError(f"estimator: {n_o} disturbances are too many for {n_y} outputs")
        process, drift = vector("process", s.process, n_x), vector("drift", s.drift, n_o)
        start = process if s.start is None else vector("start", s.start, n_x)
        self._n_x = n_x
        # Variances of independent steps add up, so those of one period are proportional to it.
        Q = np.diag(np.concatenate([process, drift]) ** 2) * T_s
        self._filter = ExtendedKalmanFilter(
            self.model, T_s, Q=Q, R=np.diag(vector("noise", s.noise, n_y) ** 2)
        )
        self._P0 = np.diag(np.concatenate([start, drift]) ** 2)
        self._estimate: StateEstimate | None = None
        self._d = np.zeros(0)

    @property
    def estimate(self) -> StateEstimate | None:
        """Estimate of (x, p, w) at the last measurement; None before the first."""
        return self._estimate

    def see(self, measurement: Measurement) -> Measurement:
        """Return the measurement with x estimated and the estimated (p, w) appended to d.

        The estimator assumes that the outputs of `measurement.x` were measured and that
        `measurement.u` was held since the last measurement. If an estimate is not finite, it
        starts again from the measurement.

        Raises:
            SettingsError: If, at the first measurement, the disturbances cannot be distinguished
                from the plant's state.
        """
        m = measurement
        d = m.d if m.d.ndim == 2 else m.d[None]
        # Of the plant without disturbances: what is measured holds them already.
        y = self.model.plant.g(m.x, m.u, d[0])
        if self._estimate is None:
            self._check_rank(m, d[0])
        predicted = self._predicted(m)
        self._estimate, self._d = self._filter.update(predicted, y, m.u, d[0]), d[0]
        x, offsets = self._estimate.mean[: self._n_x], self._estimate.mean[self._n_x :]
        # The MPC predicts with the disturbances as they are now: without this, it settles with an offset.
        extended = np.concatenate([d, np.tile(offsets, (len(d), 1))], axis=1)
        return replace(m, x=x, d=extended if m.d.ndim == 2 else extended[0])

    def _predicted(self, m: Measurement) -> StateEstimate:
        """Return the predicted estimate; at first, or if it is not finite, the measurement."""
        if self._estimate is not None:
            predicted = self._filter.predict(self._estimate, m.u, self._d)
            if predicted.finite:
                return predicted
        offsets = np.zeros(len(self.model.offsets))
        return StateEstimate(np.concatenate([m.x, offsets]), self._P0)

    def _check_rank(self, m: Measurement, d: Float[np.ndarray, " n_d"]) -> None:
        """Raise SettingsError unless [A - 1, B_d; C, C_d], columns scaled to 1, has full rank."""
        n = len(self._P0)
        start = StateEstimate(np.concatenate([m.x, np.zeros(n - len(m.x))]), self._P0)
        A_c, C = self._filter.linearized(start, m.u, d)
        A = kernels.discretize(A_c, np.zeros((n, 0)), np.zeros(n), self._filter.T_s)[0]
        # Lemma 1: what stays at rest, (A - 1) v = 0, and is not seen, C v = 0, cannot be estimated.
        matrix = np.concatenate([A - np.eye(n), C])
        norms = np.linalg.norm(matrix, axis=0)
        if np.any(norms == 0) or np.linalg.svd(matrix / norms)[1][-1] < 1e-9:
            raise SettingsError(
                f"estimator: disturbances of {[c.name for c in self.model.offsets]} cannot be "
                f"distinguished from the state of {self.model.plant.name!r}; choose others"
            )


class EstimatingMPC:
    """A `Controller`: a `LinearMPC` that predicts from estimates, without offset.

    `Measurement.x` is a noisy measurement.

    Args:
        plant: Plant that the controller uses as its model.
        settings: Settings of the MPC.
        estimator: Settings of the estimator.

    Raises:
        SettingsError: If the settings do not fit the plant.
    """

    def __init__(self, plant: Plant, settings: MPCSettings, estimator: EstimatorSettings) -> None:
        self.estimator = DisturbanceEstimator(plant, estimator, settings.T_s)
        self._mpc = LinearMPC(self.estimator.model, settings)

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self._mpc.T_s

    def move(self, measurement: Measurement) -> Move:
        """Estimate, then decide the next input. Raises as `DisturbanceEstimator.see`."""
        return self._mpc.move(self.estimator.see(measurement))
