"""Compiled control laws: PID, cascade of two PIDs, and linear state feedback."""

import math

import numpy as np

from prefcal_env.jit import inner

PID, CASCADE, FEEDBACK = range(3)
"""Kinds of laws."""

# Columns of a row of PID gains.
GAIN, INTEGRAL, DERIVATIVE, FILTER, WEIGHT, TRACKING, BIAS, LOW, HIGH, STAGES, HYSTERESIS = range(11)
# Columns of a row of the memory.
_STARTED, _INTEGRATOR, _FILTERED, _OUTPUT = range(4)
MEMORY = 4
"""Number of columns of the memory, which has one row for each row of gains."""
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
