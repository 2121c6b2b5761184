"""The kinematic bicycle of section IV-B, with an exact hold."""

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel

from .plant import Equations, Jacobians, compiled, matrices_of, rates_of

X = Float[np.ndarray, " 3"]
U = Float[np.ndarray, " 2"]
D = Float[np.ndarray, " 0"]
Times = Float[np.ndarray, " K"]
States = Float[np.ndarray, "K 3"]

_SMALLEST = np.finfo(float).eps
KMH = 1 / 3.6  # one km/h in m/s


def _f(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ of eq. nonlin_bicyclemodel, (m/s, m/s, rad/s); p is the length L."""
    heading = x[2] + u[1]
    out[0], out[1] = u[0] * math.cos(heading), u[0] * math.sin(heading)
    out[2] = u[0] * math.sin(u[1]) / p[0]


def _jacobians(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write A, B, C = 1 and D = 0, row by row."""
    v, c, s = u[0], math.cos(x[2] + u[1]), math.sin(x[2] + u[1])
    for i in range(30):
        out[i] = 0.0
    out[2], out[5] = -v * s, v * c
    out[9], out[10] = c, -v * s
    out[11], out[12] = s, v * c
    out[13], out[14] = math.sin(u[1]) / p[0], v * math.cos(u[1]) / p[0]
    # C of 3 × 3 begins at 9 + 6; its diagonal is every fourth number.
    out[15], out[19], out[23] = 1.0, 1.0, 1.0


@dataclass(frozen=True, slots=True)
class Bicycle:
    """The bicycle of eq. nonlin_bicyclemodel: x = (x_f, y_f [m], θ [rad]), u = (v, δ_s).

    The inputs are v [m/s] and δ_s [rad]; time is in seconds. The reference point is the front
    wheel; y points to the left, θ is counterclockwise. All states are outputs, and there is no
    disturbance.
    """

    length: float = 4.5  # wheelbase L, the distance between the axles [m]

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
        Channel("steering angle", "rad", low=-math.pi / 4, high=math.pi / 4, symbol="δ_s"),
    )
    disturbances: tuple[Channel, ...] = ()

    def f(self, x: X, u: U, d: D) -> X:
        """Return ẋ of eq. nonlin_bicyclemodel, (m/s, m/s, rad/s)."""
        return rates_of(_f, (self.length,), x, u, d)

    def g(self, x: X, u: U, d: D) -> X:
        """Return the outputs: all states."""
        return np.array(x, dtype=float)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the analytic derivatives of eq. nonlin_bicyclemodel."""
        return matrices_of(_jacobians, (self.length,), x, u, d)

    @property
    def equations(self) -> Equations:
        """Return the compiled equations."""
        return _equations(self.length)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the exact states at `times` [s]: with u held, the front wheel follows a circle.

        A chord of it has length v t sinc(ω t / 2) and points in the mean direction.
        """
        # Copies: a read-only array or an integer is another type, for which numba compiles again.
        at, (x_f, y_f, yaw), (v, steering) = np.array(times, dtype=float), x.tolist(), u.tolist()
        states = compiled_hold()(x_f, y_f, yaw, v, steering, float(self.length), at)
        return np.asarray(states)


@cache
def compiled_hold() -> Any:
    """Return the compiled hold; for few instants numpy takes five times as long."""
    from prefcal_env.jit import kernel  # loads the compiler

    return kernel()(_hold)


def _hold(x_f, y_f, yaw, v, steering, length, times):  # type: ignore[no-untyped-def]
    """Return the states at `times` [s], shape (K, 3)."""
    states = np.empty((len(times), 3))
    rate = v * math.sin(steering) / length  # rad/s
    for i in range(len(times)):
        turned = rate * times[i]
        half = math.pi * (turned / (2 * math.pi))  # rounded like the argument of numpy's sinc
        if half == 0:
            half = _SMALLEST
        chord = v * times[i] * (math.sin(half) / half)
        # The front wheel points in yaw + δ_s; the chord, halfway between start and end.
        direction = yaw + steering + turned / 2
        states[i, 0] = x_f + chord * math.cos(direction)
        states[i, 1] = y_f + chord * math.sin(direction)
        states[i, 2] = yaw + turned
    return states


@lru_cache(maxsize=64)
def _equations(length: float) -> Equations:
    return compiled(_f, None, _jacobians, np.array([length]))
