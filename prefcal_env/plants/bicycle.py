"""The kinematic bicycle of section IV-B, with an exact hold."""

from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel

from .equations import Equations, compiled
from .plant import Jacobians

X = Float[np.ndarray, " 3"]
U = Float[np.ndarray, " 2"]
D = Float[np.ndarray, " 0"]
Times = Float[np.ndarray, " K"]
States = Float[np.ndarray, "K 3"]

KMH = 1 / 3.6
"""One km/h in m/s."""


@dataclass(frozen=True, slots=True)
class Bicycle:
    """The bicycle of eq. nonlin_bicyclemodel: x = (x_f, y_f [m], θ [rad]), u = (v, δ_s).

    The inputs are v [m/s] and δ_s [rad]; time is in seconds. The reference point is the front
    wheel; y points to the left, θ is counterclockwise. All states are outputs, and there is no
    disturbance.

    Args:
        length: Wheelbase L, the distance between the axles [m].
    """

    length: float = 4.5

    def __post_init__(self) -> None:
        if not 0 < self.length < np.inf:
            raise PlantError(f"the length L must be positive and finite, got {self.length} m")

    name = "bicycle"
    time_unit = "s"
    states = (
        Channel("longitudinal position", "m", symbol="x_f"),
        Channel("lateral position", "m", symbol="y_f"),
        Channel("yaw angle", "rad", symbol="ψ"),
    )
    outputs = states
    inputs = (
        Channel("speed", "m/s", low=40 * KMH, high=70 * KMH, symbol="v"),
        Channel("steering angle", "rad", low=-pi / 4, high=pi / 4, symbol="δ_s"),
    )
    disturbances: tuple[Channel, ...] = ()

    def f(self, x: X, u: U, d: D) -> X:
        """Return ẋ of eq. nonlin_bicyclemodel, (m/s, m/s, rad/s)."""
        (_, _, yaw), (v, steering) = x.tolist(), u.tolist()
        heading = yaw + steering
        return np.array([v * cos(heading), v * sin(heading), v * sin(steering) / self.length])

    def g(self, x: X, u: U, d: D) -> X:
        """Return the outputs: all states."""
        return np.array(x, dtype=float)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the analytic derivatives of eq. nonlin_bicyclemodel."""
        (_, _, yaw), (v, steering) = x.tolist(), u.tolist()
        c, s = cos(yaw + steering), sin(yaw + steering)
        A = np.array([[0.0, 0.0, -v * s], [0.0, 0.0, v * c], [0.0, 0.0, 0.0]])
        turn, bend = sin(steering) / self.length, v * cos(steering) / self.length
        B = np.array([[c, -v * s], [s, v * c], [turn, bend]])
        return Jacobians(A, B, np.eye(3), np.zeros((3, 2)))

    @property
    def equations(self) -> Equations:
        """Return the compiled equations."""
        return _equations(self.length)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the exact states at `times` [s]: with u held, the front wheel follows a circle.

        A chord of it has length v t sinc(ω t / 2) and points in the mean direction.
        """
        from . import _car_kernels  # loads the compiler

        (x_f, y_f, yaw), (v, steering) = x.tolist(), u.tolist()
        # A copy: a read-only array is another type, for which the kernel would be compiled again.
        at = np.array(times, dtype=float)
        length = float(self.length)  # an integer is another type, too
        states = _car_kernels.hold_bicycle(x_f, y_f, yaw, v, steering, length, at)
        return np.asarray(states)


@lru_cache(maxsize=64)
def _equations(length: float) -> Equations:
    from . import _car_kernels  # loads the compiler

    jacobians = _car_kernels.bicycle_jacobians
    return compiled(_car_kernels.bicycle, None, jacobians, np.array([length]))
