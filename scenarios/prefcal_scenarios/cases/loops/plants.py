"""Plants of the loops, compiled: right-hand sides, control laws, and the simulation of a loop."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numba
import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel
from prefcal_env.jit import inner, kernel
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y
from prefcal_env.plants.plant import Equations, compiled

# --- Kinds of plants: of each its parameters, and its compiled right-hand side ẋ = f(x, u, d).
#
# A right-hand side reads the parameters by their position. The code loops over numbers and uses no
# slices, which take seconds to compile.

GRAVITY = 9.81  # m/s²
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

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the parameters by name."""
        return {"bottom": "m²", "widening": "m²/m", "outlet": "m²", "pump_gain": "m³/s", "pump_lag": "s"}


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

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the parameters by name."""
        sizes = {f"{what}_{k}": "m²" for what in ("area", "outlet") for k in (1, 2, 3, 4)}
        return {**sizes, "pump_gain": "m³/(s V)"}


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

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the parameters by name."""
        masses, friction = dict.fromkeys(("motor", "load"), "kg m²"), "N m s/rad"
        shaft = {"half_gap": "rad", "stiffness": "N m/rad", "damping": friction}
        return {**masses, **shaft, "viscous": friction, "coulomb": "N m"}


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

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the parameters by name."""
        return {"cart": "kg", "pole": "kg", "length": "m", "friction": "N s/m"}


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

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the parameters by name."""
        return {"inductance": "mH", "capacitance": "mF", "load": "Ω", "supply": "V", "resistance": "Ω"}


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

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the parameters by name."""
        return {"speed": "m/s", "wheelbase": "m", "lag": "s"}


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


# --- Compiled control laws: PID, cascade of two PIDs, and linear state feedback.

PID, CASCADE, FEEDBACK = range(3)  # kinds of laws

# Columns of a row of PID gains.
GAIN, INTEGRAL, DERIVATIVE, FILTER, WEIGHT, TRACKING, BIAS, LOW, HIGH, STAGES, HYSTERESIS = range(11)
# Columns of a row of the memory.
_STARTED, _INTEGRATOR, _FILTERED, _OUTPUT = range(4)
MEMORY = 4  # number of columns of the memory, which has one row for each row of gains
# Columns of a row of the actuators.
_STICTION, _BACKLASH, _RESOLUTION, _LOWEST = range(4)


@inner()
def decide(law, gains, reference, y, memory, T_s, u):  # type: ignore[no-untyped-def]
    """Write the inputs of this sampling instant to `u`; `reference` and `y` are in one order."""
    if law == CASCADE:
        # With literals numba would compile `_pid` again for each of them.
        first, second = np.int64(0), np.int64(1)
        inside = _pid(gains, first, reference[0], y[0], memory, T_s)
        u[0] = _pid(gains, second, inside, y[1], memory, T_s)
    elif law == FEEDBACK:
        for j in range(len(u)):
            u[j] = _feedback(gains, j, reference, y, memory, T_s)
    else:
        for j in range(len(u)):
            u[j] = _pid(gains, j, reference[j], y[j], memory, T_s)


@inner()
def _pid(gains, j, r, y, memory, T_s):  # type: ignore[no-untyped-def]
    """Return the output of row `j`: filtered measurement, set-point weight, back-calculation.

    The integrator follows the limits only, not the stages, which would make it dither.
    """
    K, T_i, T_d = gains[j, GAIN], gains[j, INTEGRAL], gains[j, DERIVATIVE]
    if memory[j, _STARTED] == 0.0:
        memory[j, _STARTED] = 1.0
        memory[j, _FILTERED] = y
        memory[j, _OUTPUT] = gains[j, BIAS]
        # Start without a jump: the first move is the weighted step, K b (r - y).
        memory[j, _INTEGRATOR] = K * (1.0 - gains[j, WEIGHT]) * y
    before = memory[j, _FILTERED]
    now = before + T_s / (gains[j, FILTER] + T_s) * (y - before)
    memory[j, _FILTERED] = now
    proportional = K * (gains[j, WEIGHT] * r - now)
    rate = -K * T_d * (now - before) / T_s
    wanted = gains[j, BIAS] + proportional + memory[j, _INTEGRATOR] + rate
    limited = min(max(wanted, gains[j, LOW]), gains[j, HIGH])
    memory[j, _INTEGRATOR] += K * T_s / T_i * (r - now)
    memory[j, _INTEGRATOR] += min(T_s / gains[j, TRACKING], 1.0) * (limited - wanted)
    memory[j, _OUTPUT] = _staged(gains, j, limited, memory[j, _OUTPUT])
    return memory[j, _OUTPUT]


@inner()
def _staged(gains, j, wanted, now):  # type: ignore[no-untyped-def]
    """Return the stage nearest to `wanted`; hysteresis, a share of a stage, favors `now`."""
    stages = gains[j, STAGES]
    if stages < 1.0:
        return wanted
    low = gains[j, LOW]
    width = (gains[j, HIGH] - low) / stages
    if abs(wanted - now) <= (0.5 + gains[j, HYSTERESIS]) * width:
        return now
    return low + width * math.floor((wanted - low) / width + 0.5)


@inner()
def _feedback(gains, j, reference, y, memory, T_s):  # type: ignore[no-untyped-def]
    """Return bias - K (y - r) - K_z z, with z the integrated error of the first output.

    A row holds K, K_z, bias, low and high. Nothing is integrated while the input is at a limit.
    """
    n = len(y)
    wanted = gains[j, n + 1] - gains[j, n] * memory[j, _INTEGRATOR]
    for i in range(n):
        wanted -= gains[j, i] * (y[i] - reference[i])
    limited = min(max(wanted, gains[j, n + 2]), gains[j, n + 3])
    if limited == wanted:
        memory[j, _INTEGRATOR] += T_s * (y[0] - reference[0])
    return limited


@inner()
def moved(actuators, j, wanted, before):  # type: ignore[no-untyped-def]
    """Return where actuator `j` goes from `before`: it sticks, has play, and moves in steps.

    It does not move at all for a change up to its stiction, stays within its backlash of what is
    wanted, and stands at multiples of its resolution above its lowest position.
    """
    if abs(wanted - before) <= actuators[j, _STICTION]:
        return before
    play, lowest = actuators[j, _BACKLASH], actuators[j, _LOWEST]
    reached = min(max(before, wanted - play), wanted + play)
    return lowest + rounded(reached - lowest, actuators[j, _RESOLUTION])


@inner()
def rounded(value, resolution):  # type: ignore[no-untyped-def]
    """Return the nearest multiple of `resolution`, or `value` itself if that is 0."""
    if resolution <= 0.0:
        return value
    return resolution * math.floor(value / resolution + 0.5)


# --- Compiled fixed-step simulation of a closed loop: dead time, noise, disturbance, saturation.


@kernel()
def simulate(plant, control, signals, timing, start):  # type: ignore[no-untyped-def]
    """Simulate K instants and return x (K, n_x), u (K, n_u) and how many instants are valid.

    The simulation stops after the first state that is outside its limits or not finite; a state
    that is not finite is not valid.

    Args:
        plant: Kind, parameters, and indices of the measured states (n_m,).
        control: Kind of law, its gains (rows, columns), the actuators (0 or n_u, 4), see
            `_laws.moved`, and the resolution of the measured states (0 or n_m,).
        signals: Reference (K, n_m), disturbance (K, n_d) and measurement noise (K, n_m).
        timing: Step, steps in a sampling period, steps of dead time, and time constant of the actuators.
        start: State (n_x,) and inputs (n_u,) at the start, and limits of the states (n_x, 2).
    """
    kind, p, measured = plant
    law, gains, actuators, resolution = control
    reference, disturbance, noise = signals
    dt, hold, delay, lag = timing
    x0, u0, limits = start
    count, n_x = len(reference), len(x0)
    x, u = np.zeros((count, n_x)), np.zeros((count, len(u0)))
    memory, y = np.zeros((len(gains), MEMORY)), np.zeros(len(measured))
    work, reached, held = np.zeros((5, n_x)), u0.copy(), u0.copy()
    _copy(x0, x[0])
    for k in range(count):
        if k % hold == 0:
            for i in range(len(measured)):
                y[i] = x[k, measured[i]] + noise[k, i]
            for i in range(len(resolution)):
                y[i] = rounded(y[i], resolution[i])
            decide(law, gains, reference[k], y, memory, hold * dt, u[k])
            for j in range(len(actuators)):
                u[k, j] = moved(actuators, j, u[k, j], u[k - 1, j] if k > 0 else u0[j])
        else:
            _copy(u[k - 1], u[k])
        if k + 1 < count:
            applied = u[k - delay] if k >= delay else u0
            _follow(applied, lag, dt, reached, held)
            _step(kind, p, x[k], held, disturbance[k], dt, work, x[k + 1])
            inside, finite = _within(x[k + 1], limits)
            if not inside:
                if finite:
                    _copy(u[k], u[k + 1])
                return x, u, k + 2 if finite else k + 1
    return x, u, count


@inner()
def _copy(source, target):  # type: ignore[no-untyped-def]
    """Copy a vector: assigning to a slice would take seconds to compile."""
    for i in range(len(source)):
        target[i] = source[i]


@inner()
def _follow(u, lag, dt, reached, held):  # type: ignore[no-untyped-def]
    """Move actuators on towards `u`, and write their mean meanwhile to `held`."""
    for j in range(len(u)):
        missing = reached[j] - u[j]
        reached[j] = u[j] + missing * math.exp(-dt / lag) if lag > 0.0 else u[j]
        held[j] = u[j] + missing * (1.0 - math.exp(-dt / lag)) * lag / dt if lag > 0.0 else u[j]


@inner()
def _step(kind, p, x, u, d, dt, work, out):  # type: ignore[no-untyped-def]
    """Write the state after one Runge-Kutta step of order 4 to `out`."""
    k1, k2, k3, k4, between = work[0], work[1], work[2], work[3], work[4]
    derivative(kind, p, x, u, d, k1)
    for i in range(len(x)):
        between[i] = x[i] + dt / 2 * k1[i]
    derivative(kind, p, between, u, d, k2)
    for i in range(len(x)):
        between[i] = x[i] + dt / 2 * k2[i]
    derivative(kind, p, between, u, d, k3)
    for i in range(len(x)):
        between[i] = x[i] + dt * k3[i]
    derivative(kind, p, between, u, d, k4)
    for i in range(len(x)):
        out[i] = x[i] + dt / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i])


@inner()
def _within(x, limits):  # type: ignore[no-untyped-def]
    """Return whether the state is within its limits, and whether it is finite."""
    inside, finite = True, True
    for i in range(len(x)):
        if not math.isfinite(x[i]):
            finite = False
        if not (limits[i, 0] <= x[i] <= limits[i, 1]):
            inside = False
    return inside, finite


@kernel()
def advance(plant, timing, at, history, limits):  # type: ignore[no-untyped-def]
    """Simulate one sampling period, writing to `x`.

    Return how many instants are valid, and whether the simulation stops there.

    Args:
        plant: Kind and parameters.
        timing: Step, steps of dead time of the inputs, and time constant of the actuators.
        at: First instant of the period and of the next one.
        history: States (K, n_x), inputs (K, n_u), written up to the end of the period, inputs
            before the start (n_u,), disturbances (K, n_d), and where the actuators are (n_u,).
        limits: Limits of the states (n_x, 2).
    """
    kind, p = plant
    first, last = at
    dt, delay, lag = timing
    x, u, u0, disturbance, reached = history
    work, held = np.zeros((5, x.shape[1])), u0.copy()
    for k in range(first, last):
        applied = u[k - delay] if k >= delay else u0
        _follow(applied, lag, dt, reached, held)
        _step(kind, p, x[k], held, disturbance[k], dt, work, x[k + 1])
        inside, finite = _within(x[k + 1], limits)
        if not inside:
            return k + 2 if finite else k + 1, True
    return last + 1, False


@kernel()
def hold(kind, p, x, u, d, times, dt):  # type: ignore[no-untyped-def]
    """Return the states at `times`, shape (K, n_x), by steps of at most `dt`."""
    out = np.zeros((len(times), len(x)))
    work, now, after = np.zeros((5, len(x))), x.copy(), x.copy()
    t = 0.0
    for k in range(len(times)):
        count = max(math.ceil((times[k] - t) / dt - 1e-9), 1)
        for _ in range(count):
            _step(kind, p, now, u, d, (times[k] - t) / count, work, after)
            _copy(after, now)
        t = times[k]
        _copy(now, out[k])
    return out


@kernel()
def slopes(kind, p, x, u, d):  # type: ignore[no-untyped-def]
    """Return A = ∂ẋ/∂x and B = ∂ẋ/∂u by central differences."""
    n, m = len(x), len(u)
    A, B, work = np.zeros((n, n)), np.zeros((n, m)), np.zeros((2, n))
    for j in range(n):
        _slope(kind, p, x, u, d, (x, j), work, A)
    for j in range(m):
        _slope(kind, p, x, u, d, (u, j), work, B)
    return A, B


@inner()
def _slope(kind, p, x, u, d, place, work, out):  # type: ignore[no-untyped-def]
    """Write ∂ẋ over the number at `place`, in x or u, to its column of `out`."""
    vector, j = place
    here = vector[j]
    h = 1e-6 * max(abs(here), 1.0)
    vector[j] = here + h
    derivative(kind, p, x, u, d, work[0])
    vector[j] = here - h
    derivative(kind, p, x, u, d, work[1])
    vector[j] = here
    for i in range(len(x)):
        out[i, j] = (work[0, i] - work[1, i]) / (2 * h)


@kernel()
def rhs(kind, p, x, u, d):  # type: ignore[no-untyped-def]
    """Return ẋ of the plant `kind` with parameters `p`, shape (n_x,)."""
    dx = np.zeros(len(x))
    derivative(kind, p, x, u, d, dx)
    return dx


# --- A plant of the loops: parameters with a compiled right-hand side, as a plant of `prefcal_env`.

carray: Any = numba.carray  # type: ignore[attr-defined]
_HEAD = 6  # numbers before the indices of the measured states in the parameters of the C functions


@dataclass(frozen=True)
class CompiledPlant:
    """A `prefcal_env` plant that is simulated by compiled Runge-Kutta steps of fixed length.

    Its outputs are the measured states; their limits are not those of the states, within which an
    experiment is safe. An MPC that uses the plant as its model leaves the dead time out.
    """

    parameters: Parameters  # kind of plant and its parameters
    states: tuple[Channel, ...]  # states, with the limits of safe operation
    inputs: tuple[Channel, ...]  # inputs, with the limits at which they saturate
    max_step: float  # step of the simulation, in `time_unit`
    measured: tuple[int, ...] = (0,)  # indices of the measured states
    dead_time: float = 0.0  # dead time of the inputs, in `time_unit`
    time_unit: str = "s"  # unit of time
    disturbances: tuple[Channel, ...] = (Channel("disturbance"),)  # what acts beside the inputs

    @property
    def name(self) -> str:
        """Name of the kind of plant."""
        return type(self.parameters).__name__

    @cached_property
    def outputs(self) -> tuple[Channel, ...]:
        """The measured states."""
        return tuple(Channel(self.states[i].name, self.states[i].unit) for i in self.measured)

    @property
    def input_delay(self) -> tuple[float, ...]:
        """Dead time of each input, in `time_unit`."""
        return (self.dead_time,) * len(self.inputs)

    @property
    def equations(self) -> Equations:
        """Return the compiled equations, which are compiled the first time."""
        kind, parameters = self.packed
        channels = self.states, self.inputs, self.disturbances, self.measured
        head = np.array([kind, *map(len, channels), len(parameters)], dtype=float)
        return replace(compile_equations(), parameters=np.concatenate([head, self.measured, parameters]))

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return np.asarray(rhs(*self.packed, *_copies(x, u, d)))

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the measured states."""
        return np.asarray(self._C @ x)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives of f, by central differences, and of g."""
        A, B = slopes(*self.packed, *_copies(x, u, d))
        return Jacobians(A, B, self._C, np.zeros((len(self.measured), len(self.inputs))))

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`, with the inputs held."""
        return np.asarray(hold(*self.packed, *_copies(x, u, d), times, self.max_step))

    @property
    def named_matrices(self) -> tuple[np.ndarray, np.ndarray] | None:
        """A and B, with what acts beside the inputs, of a linear plant; None of another one."""
        if not isinstance(self.parameters, Linear):
            return None
        A, B, E = (np.array(M, dtype=float) for M in self.parameters)
        return A, np.column_stack([B, E])

    def scaled(
        self, rates: Float[np.ndarray, " n_x"], gains: Float[np.ndarray, " n_u"], later: float
    ) -> "CompiledPlant":
        """Return the same plant with more dead time and, if it is linear, faster states and larger gains."""
        parameters = self.parameters
        if isinstance(parameters, Linear):
            A, B, E = (np.array(M, dtype=float) * rates[:, None] for M in parameters)
            parameters = Linear(*(tuple(map(tuple, M.tolist())) for M in (A, B * gains, E)))
        return replace(self, parameters=parameters, dead_time=later * self.dead_time)

    @cached_property
    def packed(self) -> tuple[int, Float[np.ndarray, " n_p"]]:
        """Number of the kind of plant, and its parameters, shape (n_p,)."""
        return packed(self.parameters)

    @cached_property
    def _C(self) -> Float[np.ndarray, "n_y n_x"]:
        return np.eye(len(self.states))[list(self.measured)]


def compile_equations() -> Equations:
    """Compile the equations that all plants share, and return them without parameters."""
    return compiled(_f, _g, _jacobians, np.zeros(0))


def _copies(x: X, u: U, d: D) -> tuple[X, U, D]:
    """Return writable copies: numba compiles again for read-only arrays, another type."""
    return np.array(x, dtype=float), np.array(u, dtype=float), np.array(d, dtype=float)


@inner()
def _parts(p):  # type: ignore[no-untyped-def]
    """Return the kind, the numbers of x, u and d, the measured states and the parameters."""
    n_y, n_p = int(p[4]), int(p[5])
    numbers = carray(p, (_HEAD + n_y + n_p,))
    return int(p[0]), (int(p[1]), int(p[2]), int(p[3])), numbers[_HEAD : _HEAD + n_y], numbers[_HEAD + n_y :]


def _f(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ."""
    kind, (n_x, n_u, n_d), _, own = _parts(p)
    derivative(kind, own, carray(x, (n_x,)), carray(u, (n_u,)), carray(d, (n_d,)), carray(out, (n_x,)))


def _g(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write the measured states."""
    _, _, measured, _ = _parts(p)
    for i in range(len(measured)):
        out[i] = x[int(measured[i])]


def _jacobians(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write A and B, by central differences, C and D = 0."""
    kind, (n_x, n_u, n_d), measured, own = _parts(p)
    A, B = slopes(kind, own, carray(x, (n_x,)).copy(), carray(u, (n_u,)).copy(), carray(d, (n_d,)))
    n_A, n_B, n_y = n_x * n_x, n_x * n_u, len(measured)
    for i in range(n_x):
        for j in range(n_x):
            out[i * n_x + j] = A[i, j]
        for j in range(n_u):
            out[n_A + i * n_u + j] = B[i, j]
    for i in range(n_A + n_B, n_A + n_B + n_y * (n_x + n_u)):
        out[i] = 0.0
    for i in range(n_y):
        out[n_A + n_B + i * n_x + int(measured[i])] = 1.0
