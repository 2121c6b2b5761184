"""Kinds of plants: of each its parameters, and its compiled right-hand side ẋ = f(x, u, d).

A right-hand side reads the parameters by their position. The code loops over numbers and uses no
slices, which take seconds to compile.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from prefcal_env.jit import inner

GRAVITY = 9.81
"""m/s²"""
_STANDSTILL = 0.02
"""Speed below which Coulomb friction fades, in rad/s: a sign function would need tiny steps."""

Rows = tuple[tuple[float, ...], ...]


class Linear(NamedTuple):
    """Linear plant ẋ = A x + B u + E d; each matrix is a tuple of rows."""

    A: Rows
    B: Rows
    E: Rows


@inner()
def _linear(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    n, m, q = len(x), len(u), len(d)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += p[i * n + j] * x[j]
        for j in range(m):
            total += p[n * n + i * m + j] * u[j]
        for j in range(q):
            total += p[n * (n + m) + i * q + j] * d[j]
        dx[i] = total


class Tank(NamedTuple):
    """Tank that widens upwards; x = (level [m], pump flow [m³/s]), d = (additional inflow)."""

    bottom: float = 0.05  # cross-section at the bottom, m²
    widening: float = 0.25  # increase of the cross-section with the level, m²/m
    outlet: float = 4e-4  # cross-section of the outlet, m²
    pump_gain: float = 3e-3  # flow at full power, m³/s
    pump_lag: float = 3.0  # time constant of the pump, s


@inner()
def _tank(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    bottom, widening, outlet, pump_gain, pump_lag = p[0], p[1], p[2], p[3], p[4]
    area = bottom + widening * max(x[0], 0.0)
    dx[0] = (x[1] + d[0] - outlet * _outflow(x[0])) / area
    dx[1] = (pump_gain * u[0] - x[1]) / pump_lag


@inner()
def _outflow(level):  # type: ignore[no-untyped-def]
    """Speed of a jet under `level` (Torricelli), 0 for an empty tank."""
    return math.sqrt(2.0 * GRAVITY * level) if level > 0.0 else 0.0


class QuadrupleTank(NamedTuple):
    """Johansson's four tanks with two pumps; tanks 3 and 4 drain into 1 and 2.

    x = four levels [m], u = voltages [V], d = (inflow to tank 1 [m³/s]).
    """

    area_1: float = 28e-4  # cross-section of tank 1, m²
    area_2: float = 32e-4  # cross-section of tank 2, m²
    area_3: float = 28e-4  # cross-section of tank 3, m²
    area_4: float = 32e-4  # cross-section of tank 4, m²
    outlet_1: float = 7.1e-6  # cross-section of the outlet of tank 1, m²
    outlet_2: float = 5.7e-6  # cross-section of the outlet of tank 2, m²
    outlet_3: float = 7.1e-6  # cross-section of the outlet of tank 3, m²
    outlet_4: float = 5.7e-6  # cross-section of the outlet of tank 4, m²
    pump_gain: float = 3.3e-6  # flow per voltage, m³/(s V)
    share_1: float = 0.70  # share of pump 1's flow that goes to tank 1; the rest goes to tank 4
    share_2: float = 0.60  # share of pump 2's flow that goes to tank 2; the rest goes to tank 3


@inner()
def _quadruple(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    pump_gain, share_1, share_2 = p[8], p[9], p[10]
    flow_1, flow_2 = pump_gain * u[0], pump_gain * u[1]
    out_1, out_2 = p[4] * _outflow(x[0]), p[5] * _outflow(x[1])
    out_3, out_4 = p[6] * _outflow(x[2]), p[7] * _outflow(x[3])
    dx[0] = (out_3 - out_1 + share_1 * flow_1 + d[0]) / p[0]
    dx[1] = (out_4 - out_2 + share_2 * flow_2) / p[1]
    dx[2] = ((1.0 - share_2) * flow_2 - out_3) / p[2]
    dx[3] = ((1.0 - share_1) * flow_1 - out_4) / p[3]


class Servo(NamedTuple):
    """Motor, shaft with backlash, and load with friction, in SI units.

    x = (load angle [rad], motor speed [rad/s], load speed [rad/s], twist of the shaft [rad]),
    d = (torque at the load [N m]).
    """

    motor: float = 0.01  # inertia of the motor, kg m²
    load: float = 0.02  # inertia of the load, kg m²
    viscous: float = 0.01  # viscous friction of either, N m s/rad
    coulomb: float = 0.05  # Coulomb friction of the load, N m
    half_gap: float = 0.01  # half of the backlash, rad
    stiffness: float = 20.0  # stiffness of the shaft, N m/rad
    damping: float = 0.05  # damping of the shaft, N m s/rad


@inner()
def _servo(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    motor, load, viscous, coulomb = p[0], p[1], p[2], p[3]
    half_gap, stiffness, damping = p[4], p[5], p[6]
    slip = x[1] - x[2]
    torque = 0.0
    if x[3] > half_gap:
        torque = max(stiffness * (x[3] - half_gap) + damping * slip, 0.0)
    elif x[3] < -half_gap:
        torque = min(stiffness * (x[3] + half_gap) + damping * slip, 0.0)
    dx[0] = x[2]
    dx[1] = (u[0] - torque - viscous * x[1]) / motor
    dx[2] = (torque - viscous * x[2] - coulomb * math.tanh(x[2] / _STANDSTILL) - d[0]) / load
    dx[3] = slip


class CartPole(NamedTuple):
    """Pole on a cart, d = (push [N]).

    x = (position [m], angle from upright [rad], speed [m/s], angular speed [rad/s]).
    """

    cart: float = 1.0  # mass of the cart, kg
    pole: float = 0.2  # mass at the end of the pole, kg
    length: float = 0.6  # length of the pole, m
    friction: float = 0.3  # viscous friction of the cart, N s/m


@inner()
def _cart_pole(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    cart, pole, length, friction = p[0], p[1], p[2], p[3]
    sine, cosine = math.sin(x[1]), math.cos(x[1])
    force = u[0] + d[0] - friction * x[2] + pole * length * x[3] * x[3] * sine
    total = cart + pole * sine * sine
    dx[0] = x[2]
    dx[1] = x[3]
    dx[2] = (force - pole * GRAVITY * sine * cosine) / total
    dx[3] = ((cart + pole) * GRAVITY * sine - force * cosine) / (total * length)


class BoostConverter(NamedTuple):
    """Averaged boost converter, time in ms.

    x = (output voltage [V], coil current [A]), d = (additional load [A]).
    """

    inductance: float = 0.2  # inductance of the coil, mH
    capacitance: float = 0.47  # capacitance at the output, mF
    load: float = 12.0  # resistance of the load, Ω
    supply: float = 12.0  # supply voltage, V
    resistance: float = 0.15  # resistance of the coil, Ω


@inner()
def _boost(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    inductance, capacitance, load, supply, resistance = p[0], p[1], p[2], p[3], p[4]
    open_share = 1.0 - u[0]
    dx[0] = (open_share * x[1] - x[0] / load - d[0]) / capacitance
    dx[1] = (supply - resistance * x[1] - open_share * x[0]) / inductance


class Steering(NamedTuple):
    """Kinematic bicycle, d = (side drift [m/s]).

    x = (lateral position [m], heading [rad], steering angle [rad]).
    """

    speed: float = 15.0  # speed, m/s
    wheelbase: float = 2.8  # distance of the axles, m
    lag: float = 0.15  # time constant of the steering, s


@inner()
def _steering(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    speed, wheelbase, lag = p[0], p[1], p[2]
    dx[0] = speed * math.sin(x[1]) + d[0]
    dx[1] = speed / wheelbase * math.tan(x[2])
    dx[2] = (u[0] - x[2]) / lag


Parameters = Linear | Tank | QuadrupleTank | Servo | CartPole | BoostConverter | Steering
_KINDS = (Linear, Tank, QuadrupleTank, Servo, CartPole, BoostConverter, Steering)


def packed(parameters: Parameters) -> tuple[int, Float[np.ndarray, " n_p"]]:
    """Return the number of the kind, and the parameters, matrices row by row."""
    numbers = [np.ravel(np.array(value, dtype=float)) for value in parameters]
    return _KINDS.index(type(parameters)), np.concatenate(numbers)


@inner()
def derivative(kind, p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Write ẋ of the plant `kind`, a position in `_KINDS`, with parameters `p` to `dx`."""
    if kind == 0:
        _linear(p, x, u, d, dx)
    elif kind == 1:
        _tank(p, x, u, d, dx)
    elif kind == 2:
        _quadruple(p, x, u, d, dx)
    elif kind == 3:
        _servo(p, x, u, d, dx)
    elif kind == 4:
        _cart_pole(p, x, u, d, dx)
    elif kind == 5:
        _boost(p, x, u, d, dx)
    else:
        _steering(p, x, u, d, dx)
