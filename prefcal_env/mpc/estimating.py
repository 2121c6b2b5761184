"""Offset-free MPC: a `LinearMPC` with an estimator of state and disturbances."""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import vector
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_env.plants.disturbed import Disturbed
from prefcal_env.plants.plant import Plant

from .controller import LinearMPC
from .estimator import Estimate, ExtendedKalmanFilter
from .kernels.hold import discretize
from .settings import MPCSettings

_LEAST_RANK = 1e-9


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
        if n_o > n_y:
            raise SettingsError(f"estimator: {n_o} disturbances are too many for {n_y} outputs")
        process, drift = vector("process", s.process, n_x), vector("drift", s.drift, n_o)
        noise = vector("noise", s.noise, n_y)
        start = process if s.start is None else vector("start", s.start, n_x)
        self._n_x = n_x
        self._filter = ExtendedKalmanFilter(
            self.model, T_s, Q=np.diag(np.concatenate([process, drift]) ** 2) * T_s, R=np.diag(noise**2)
        )
        self._P0 = np.diag(np.concatenate([start, drift]) ** 2)
        self._estimate: Estimate | None = None
        self._d = np.zeros(0)

    @property
    def estimate(self) -> Estimate | None:
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
        y = self.model.plant.g(m.x, m.u, d[0])
        if self._estimate is None:
            self._check_rank(m, d[0])
        predicted = self._predicted(m)
        self._estimate, self._d = self._filter.update(predicted, y, m.u, d[0]), d[0]
        x, offsets = self._estimate.mean[: self._n_x], self._estimate.mean[self._n_x :]
        extended = np.concatenate([d, np.tile(offsets, (len(d), 1))], axis=1)
        return replace(m, x=x, d=extended if m.d.ndim == 2 else extended[0])

    def _predicted(self, m: Measurement) -> Estimate:
        """Return the predicted estimate; at first, or if it is not finite, the measurement."""
        if self._estimate is not None:
            predicted = self._filter.predict(self._estimate, m.u, self._d)
            if predicted.finite:
                return predicted
        offsets = np.zeros(len(self.model.offsets))
        return Estimate(np.concatenate([m.x, offsets]), self._P0)

    def _check_rank(self, m: Measurement, d: Float[np.ndarray, " n_d"]) -> None:
        """Raise SettingsError unless [A - 1, B_d; C, C_d], columns scaled to 1, has full rank."""
        n = len(self._P0)
        start = Estimate(np.concatenate([m.x, np.zeros(n - len(m.x))]), self._P0)
        A_c, C = self._filter.linearized(start, m.u, d)
        A = discretize(A_c, np.zeros((n, 0)), np.zeros(n), self._filter.T_s)[0]
        matrix = np.concatenate([A - np.eye(n), C])
        norms = np.linalg.norm(matrix, axis=0)
        if np.any(norms == 0) or np.linalg.svd(matrix / norms)[1][-1] < _LEAST_RANK:
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
