"""Compiled right-hand sides ẋ = f(x, u, d) of the plants.

The code loops over numbers and uses no slices, which take seconds to compile.
"""

import math

from prefcal_env.jit import inner

LINEAR, TANK, QUADRUPLE, SERVO, CART_POLE, BOOST, STEERING = range(7)
"""Kinds of plants: the number selects the right-hand side."""

GRAVITY = 9.81
"""m/s²"""
_STANDSTILL = 0.02
"""Speed below which Coulomb friction fades, in rad/s: a sign function would need tiny steps."""


@inner()
def derivative(kind, p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Write ẋ of the plant `kind` with parameters `p` to `dx`."""
    if kind == LINEAR:
        _linear(p, x, u, d, dx)
    elif kind == TANK:
        _tank(p, x, u, d, dx)
    elif kind == QUADRUPLE:
        _quadruple(p, x, u, d, dx)
    elif kind == SERVO:
        _servo(p, x, u, d, dx)
    elif kind == CART_POLE:
        _cart_pole(p, x, u, d, dx)
    elif kind == BOOST:
        _boost(p, x, u, d, dx)
    else:
        _steering(p, x, u, d, dx)


@inner()
def _linear(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """ẋ = A x + B u + E d; `p` holds A, B and E, each row by row."""
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


@inner()
def _outflow(level):  # type: ignore[no-untyped-def]
    """Speed of a jet under `level` (Torricelli), 0 for an empty tank."""
    return math.sqrt(2.0 * GRAVITY * level) if level > 0.0 else 0.0


@inner()
def _tank(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Tank that widens upwards; x = (level, pump flow), d = (additional inflow)."""
    bottom, widening, outlet, pump_gain, pump_lag = p[0], p[1], p[2], p[3], p[4]
    area = bottom + widening * max(x[0], 0.0)
    dx[0] = (x[1] + d[0] - outlet * _outflow(x[0])) / area
    dx[1] = (pump_gain * u[0] - x[1]) / pump_lag


@inner()
def _quadruple(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Two pumps and four tanks; tanks 3 and 4 drain into 1 and 2. d = (inflow to tank 1)."""
    pump_gain, share_1, share_2 = p[8], p[9], p[10]
    flow_1, flow_2 = pump_gain * u[0], pump_gain * u[1]
    out_1, out_2 = p[4] * _outflow(x[0]), p[5] * _outflow(x[1])
    out_3, out_4 = p[6] * _outflow(x[2]), p[7] * _outflow(x[3])
    dx[0] = (out_3 - out_1 + share_1 * flow_1 + d[0]) / p[0]
    dx[1] = (out_4 - out_2 + share_2 * flow_2) / p[1]
    dx[2] = ((1.0 - share_2) * flow_2 - out_3) / p[2]
    dx[3] = ((1.0 - share_1) * flow_1 - out_4) / p[3]


@inner()
def _servo(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Motor, shaft with backlash, load; x = (load angle, motor speed, load speed, twist)."""
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


@inner()
def _cart_pole(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Pole on a cart; x = (position, angle from upright, speed, angular speed), d = (push)."""
    cart, pole, length, friction = p[0], p[1], p[2], p[3]
    sine, cosine = math.sin(x[1]), math.cos(x[1])
    force = u[0] + d[0] - friction * x[2] + pole * length * x[3] * x[3] * sine
    total = cart + pole * sine * sine
    dx[0] = x[2]
    dx[1] = x[3]
    dx[2] = (force - pole * GRAVITY * sine * cosine) / total
    dx[3] = ((cart + pole) * GRAVITY * sine - force * cosine) / (total * length)


@inner()
def _boost(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Averaged boost converter; x = (output voltage, coil current), d = (additional load)."""
    inductance, capacitance, load, supply, resistance = p[0], p[1], p[2], p[3], p[4]
    open_share = 1.0 - u[0]
    dx[0] = (open_share * x[1] - x[0] / load - d[0]) / capacitance
    dx[1] = (supply - resistance * x[1] - open_share * x[0]) / inductance


@inner()
def _steering(p, x, u, d, dx):  # type: ignore[no-untyped-def]
    """Kinematic bicycle; x = (lateral position, heading, steering angle), d = (side drift)."""
    speed, wheelbase, lag = p[0], p[1], p[2]
    dx[0] = speed * math.sin(x[1]) + d[0]
    dx[1] = speed / wheelbase * math.tan(x[2])
    dx[2] = (u[0] - x[2]) / lag
