"""The compiled episode of a plant with dead time that PIDs control, period by period.

It does what `PlantEnv.apply`, `DeadTime`, `Worn` and `PID.step` do, in their order, as `compiled_run` asks.
Of a linear plant, x' = A x + B a, y = C x + D a + o; a are inputs and disturbances, less those at rest.
Of other equations, x' = s f(x, a), y = g(x, a) + o; a are inputs as `ScaledPlant` makes them act, and
disturbances, and s is its speed.
"""

import math

import numpy as np

from prefcal_env.jit import inner, kernel
from prefcal_env.plants._dop853 import call, integrate

# --- The states after a time: one matrix exponential for each length, kept for the episode.

KEPT = 4096
"""Places for matrices, of which half are used before all are forgotten."""
PARTS = 2.0**42
"""Parts of a sampling time to which lengths are rounded: what should be equal differs by less."""


@inner()
def _multiply(a, b, factor, one, out):  # type: ignore[no-untyped-def]
    """Write factor a (one + b), where `one` is 1 for that and 0 for factor a b."""
    n = len(a)
    for i in range(n):
        for j in range(n):
            total = one * a[i, j]
            for k in range(n):
                total += a[i, k] * b[k, j]
            out[i, j] = factor * total


@inner()
def _exponential(generator, t, out):  # type: ignore[no-untyped-def]
    """Write the first rows of exp(generator t), a Taylor series that is squared again and again."""
    n, largest, halvings = len(generator), 0.0, 0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += abs(generator[i, j]) * t
        largest = max(largest, total)
    while largest > 0.5 and halvings < 2000:
        largest, halvings, t = largest / 2, halvings + 1, t / 2
    change, other = np.zeros((n, n)), np.empty((n, n))
    for k in range(14, 0, -1):  # the norm is below a half: the next term is below 1e-17
        _multiply(generator, change, t / k, 1.0, other)
        change, other = other, change
    for _ in range(halvings):
        # 1 + f, squared, is 1 + f (2 + f): without the 1, slow states beside fast ones keep their digits.
        _multiply(change, change, 1.0, 2.0, other)
        change, other = other, change
    for i in range(len(out)):
        for j in range(n):
            out[i, j] = change[i, j] + (1.0 if i == j else 0.0)


@inner()
def _power(once, n, out):  # type: ignore[no-untyped-def]
    """Write the first rows of a matrix to the power of `n`."""
    result, factor, other = np.eye(len(once)), once.copy(), np.empty(once.shape)
    while n > 0:
        if n % 2:
            _multiply(result, factor, 1.0, 0.0, other)
            result, other = other, result
        _multiply(factor, factor, 1.0, 0.0, other)
        factor, other, n = other, factor, n // 2
    for i in range(len(out)):
        for j in range(len(once)):
            out[i, j] = result[i, j]


@inner()
def _after(ago, plant, kept, x, a, out):  # type: ignore[no-untyped-def]
    """Write the state `ago` after `x`, with `a` held; NaN if it overflows."""
    generator, unit, dt = plant
    keys, matrices, count = kept
    key = np.int64(math.floor(ago / dt + 1e-6)) if dt > 0 else np.int64(math.floor(ago / unit + 0.5))
    first = ((key * 0x1E3779B97F4A7C15) >> 24) & (KEPT - 1)
    place = first
    while keys[place] >= 0 and keys[place] != key:
        place = (place + 1) & (KEPT - 1)
    if keys[place] < 0:
        if count[0] >= KEPT // 2:
            for i in range(KEPT):
                keys[i] = -1
            count[0], place = 0, first
        keys[place], count[0] = key, count[0] + 1
        if dt > 0:
            _power(generator, key, matrices[place])
        else:
            _exponential(generator, key * unit, matrices[place])
    matrix, n = matrices[place], len(x)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += matrix[i, j] * x[j]
        for j in range(len(a)):
            total += matrix[i, n + j] * a[j]
        out[i] = total


# --- Dead time: a period is divided where a delayed input changes, as in `DeadTime`.


@inner()
def _last(times, count, t):  # type: ignore[no-untyped-def]
    """Return the index of the last of the first `count` increasing times that is not after `t`."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if times[middle] <= t:
            low = middle + 1
        else:
            high = middle
    return low - 1


@inner()
def _cuts(memory, delays, start, end, out):  # type: ignore[no-untyped-def]
    """Write `start`, when a delayed input changes until `end`, and `end`; return how many."""
    times, count, tolerance = memory[0], memory[2][0], 1e-10 * (end - start)
    out[0], found = start, 1
    for i in range(len(delays)):
        for k in range(max(_last(times, count, start + tolerance - delays[i]) + 1, 1), count):
            t = times[k] + delays[i]
            if t >= end - tolerance:
                break
            place = found
            while out[place - 1] > t:
                place -= 1
            # Two inputs may change at the same instant but for rounding, and no interval is that short.
            near = t - out[place - 1] <= tolerance or (place < found and out[place] - t <= tolerance)
            if near or found > len(out) - 2:
                continue
            for later in range(found, place, -1):
                out[later] = out[later - 1]
            out[place], found = t, found + 1
    out[found] = end
    return found + 1


# --- The plant: its states after a time, and its outputs.
#
# Of `matrices` and `equations` one is None, for which numba leaves out what stands below `is not None`.


@inner()
def _copy(source, target):  # type: ignore[no-untyped-def]
    for i in range(len(source)):
        target[i] = source[i]


@inner()
def _advance(times, x, a, matrices, equations, out):  # type: ignore[no-untyped-def]
    """Write the states at `times` after `x`, with `a` acting; return whether equations are too stiff."""
    stiff = False
    if matrices is not None:
        for i in range(len(times)):
            _after(times[i], matrices[0], matrices[1], x, a, out[i])
    if equations is not None:
        f, _, speed, max_step, p, n_u = equations
        for i in range(len(times)):
            times[i] *= speed
        explicit = speed <= 0.0  # False, but not as a constant, for which numba would compile it again
        states, stiff = integrate(f, x, a[:n_u], a[n_u:], p, times, max_step, explicit)
        for i in range(len(times)):
            _copy(states[i], out[i])
    return stiff


@inner()
def _read(x, a, k, matrices, equations, outputs, y):  # type: ignore[no-untyped-def]
    """Write the outputs at the state `x`, with `a` acting in period `k`."""
    if matrices is not None:
        for i in range(len(y)):
            y[i] = outputs[k, i]
            for j in range(len(x)):
                y[i] += matrices[2][i, j] * x[j]
            for j in range(len(a)):
                y[i] += matrices[3][i, j] * a[j]
    if equations is not None:
        _, g, _, _, p, n_u = equations
        if g == 0:
            _copy(x, y)
        else:
            call(g, x, a[:n_u], a[n_u:], p, y)
        for i in range(len(y)):
            y[i] += outputs[k, i]


@inner()
def _act(j, u, k, acting):  # type: ignore[no-untyped-def]
    """Return what the input j does in period `k`, of which the actuator has `u`."""
    shifts, gains, offset = acting
    return gains[j] * (u + shifts[k, j]) + offset[j]


@inner()
def _outputs(x, u, k, system, y):  # type: ignore[no-untyped-def]
    """Write the outputs without dead time, with what is held in period `k`."""
    matrices, equations, outputs, acting = system
    a = acting[0][k].copy()
    for j in range(len(u)):
        a[j] = _act(j, u[j], k, acting)
    _read(x, a, k, matrices, equations, outputs, y)


@inner()
def _seen(t, tolerance, delays, system, spans, latest, y):  # type: ignore[no-untyped-def]
    """Write the outputs as seen at `t`, each from as long ago as its delay.

    `latest` are the time and the row of `x` of the latest state, which needs no simulation.
    """
    (matrices, equations, outputs, _), (since, states, acting, rows, count) = system, spans
    found, x, k = np.empty(len(y)), np.empty((1, states.shape[1])), 0
    for i in range(len(delays)):
        if i == 0 or delays[i] != delays[i - 1]:
            k = _last(since, count[0], t - delays[i] + tolerance)
            ago = t - delays[i] - since[k]
            if k == count[0] - 1 and abs(t - delays[i] - latest[0]) <= tolerance:
                _copy(latest[1], x[0])
            elif tolerance < ago < math.inf:
                _advance(np.full(1, ago), states[k], acting[k], matrices, equations, x)
            else:
                _copy(states[k], x[0])
            _read(x[0], acting[k], rows[k], matrices, equations, outputs, found)
        y[i] = found[i]


@inner()
def _hold(part, end, now, u, k, row, dense, loop):  # type: ignore[no-untyped-def]
    """Hold u from the start of a part until `end`, from the state `now`, which becomes that of the end.

    Write the states at the dense instants from `row` on; return the first one after `end`, or -1 if
    equations are too stiff.
    """
    (t, x), (delays, (matrices, equations, _, how), memory, spans) = dense, loop
    (since, states, acting, rows, count), (times, values, given) = spans, memory
    tolerance, cuts = 1e-10 * (end - part), np.empty(len(times) + 2)
    _copy(u, values[given[0]])
    times[given[0]], given[0] = part, given[0] + 1
    for piece in range(1, _cuts(memory, delays, part, end, cuts)):
        a, b, s, first = cuts[piece - 1], cuts[piece], count[0], row
        since[s], rows[s], count[0] = a, k, s + 1
        _copy(now, states[s])
        _copy(how[0][k], acting[s])
        for j in range(len(delays)):  # each input as it was its delay ago
            delayed = values[_last(times, given[0], a + tolerance - delays[j]), j]
            acting[s, j] = _act(j, delayed, k, how)
        while row < len(t) and t[row] <= b:
            row += 1
        # The state is needed where an input changes, also if nothing is recorded there.
        after = np.full(row - first + (row == first or t[row - 1] != b), b - a)
        for i in range(first, row):
            after[i - first] = t[i] - a
        found = np.empty((len(after), len(now)))
        if _advance(after, states[s], acting[s], matrices, equations, found):
            return -1
        for i in range(first, row):
            _copy(found[i - first], x[i])
        _copy(found[len(after) - 1], now)
    return row


# --- Controllers and actuators.


@inner()
def _clip(v, low, high):  # type: ignore[no-untyped-def]
    """Return v within its limits; NaN if any of them is."""
    return math.nan if v != v or low != low or high != high else min(max(v, low), high)


@inner()
def _step(p, m, r, y, applied):  # type: ignore[no-untyped-def]
    """Return what `PID.step` does, with its parameters `p` and its memory `m`."""
    K_p, b, c, low, high = p[0], p[1], p[2], p[3], p[4]
    integral, pole, rise, tracking, integrates = p[5], p[6], p[7], p[8], p[9]
    if r != r:
        m[0], m[4] = 0.0, applied
        return applied
    if m[0] == 0.0:
        m[0], m[1], m[2], m[5], m[6] = 1.0, applied - K_p * (b * y - y), 0.0, y, y
    elif integrates == 1.0:
        m[1] += integral * (m[5] - m[6])
        m[1] += tracking * (applied - m[3])
    change = (c * r - y) - (c * m[5] - m[6])
    m[5], m[6], m[2] = r, y, pole * (m[2] + rise * change)
    m[3] = K_p * (b * r - y) + m[1] + m[2]
    m[4] = m[3] if m[3] != m[3] else min(max(m[3], low), high)
    return m[4]


@inner()
def _decide(y, r, u, pids, wear, limits, v):  # type: ignore[no-untyped-def]
    """Write the next inputs; return whether they are numbers. Otherwise the last ones stay."""
    parameters, channels, memory = pids
    grain, play, command, commanded = wear
    low, high, move = limits
    for i in range(len(u)):
        v[i] = u[i]
        if commanded[0] == 1.0:  # see `Worn._seen`
            v[i] = _clip(_clip(command[i], u[i] - play[i], u[i] + play[i]), low[i], high[i])
    for k in range(len(parameters)):
        i, j = channels[k, 0], channels[k, 1]
        seen = np.rint(y[i] / grain[i]) * grain[i] if grain[i] > 0 else y[i]
        v[j] = _step(parameters[k], memory[k], r[i], seen, v[j])
    usable = True
    for i in range(len(u)):
        if commanded[0] >= 0.0:
            command[i] = v[i]
            v[i] = _clip(u[i], v[i] - play[i], v[i] + play[i])
        usable = usable and v[i] == v[i]
    if commanded[0] == 0.0:
        commanded[0] = 1.0
    for i in range(len(u)):
        v[i] = min(max(v[i] if usable else u[i], max(low[i], u[i] - move[i])), min(high[i], u[i] + move[i]))
    return usable


@inner()
def _actuate(u, reached, farthest, duration, lag, steps, parts):  # type: ignore[no-untyped-def]
    """Move the actuators as `PlantEnv._move_actuators`; return until when the first of two parts acts, or 0.

    `parts` are what acts at first, then, and in the mean.
    """
    straight, sudden, little = steps
    r, small = duration / lag if lag > 0.0 else math.inf, True
    left = math.exp(-r)
    for i in range(len(u)):
        farthest[i] = max(farthest[i], abs(reached[i] - u[i]))
        small = small and abs(reached[i] - u[i]) <= little * farthest[i]
    m0, m1, m2 = (1 - left) / r, (1 - (1 + r) * left) / r**2, (2 - (2 + 2 * r + r * r) * left) / r**3
    second = (3 * m2 * m0 - 4 * m1 * m1) / (m0 - 4 * m1 + 3 * m2)
    until, straight = (2 * m1 - second) / (m0 - second), small or not straight < r < sudden
    for i in range(len(u)):
        missing = reached[i] - u[i] if lag > 0.0 else 0.0
        mean = -math.expm1(-r) / r
        reached[i], parts[2, i] = u[i] + missing * left, u[i] + missing * mean
        parts[0, i] = u[i] + missing * (mean if straight else second + (m0 - second) / until)
        parts[1, i] = u[i] + missing * second
    return 0.0 if straight else until * duration


# --- The episode.


@inner()
def _write_instants(start, end, grid, row, t):  # type: ignore[no-untyped-def]
    """Write the instants after `start` that are recorded from `row` on, as `instants`; return how many."""
    close, first = 1e-9 * grid, row
    for k in range(math.floor((start + close) / grid) + 1, math.ceil((end - close) / grid)):
        t[row] = k * grid
        row += 1
    t[row] = end
    return row + 1 - first


@inner()
def _simulate(at, after, dense, k, split, parts, loop):  # type: ignore[no-untyped-def]
    """Write the states of period `k` in the rows after `at`, in two parts if `split` is not 0.

    Return whether all are finite, and whether the equations are too stiff.
    """
    t, x = dense
    now, row, part, finite = x[at].copy(), at + 1, t[at], True
    for which in range(1 if split == 0.0 else 2):
        end = t[after] if split == 0.0 or which == 1 else t[at] + split
        row = _hold(part, end, now, parts[which], k, row, dense, loop)
        if row < 0:
            return False, True
        part = end
    for row in range(at + 1, after + 1):
        for j in range(x.shape[1]):
            finite = finite and abs(x[row, j]) < math.inf
    return finite, False


@kernel()
def run(  # type: ignore[no-untyped-def]
    system, times, signals, delays, limits, lag, pids, wear, room, found
):
    """Run the episode, and return the number of steps; it ends where a state is not finite.

    If the equations of the plant are too stiff, that is 0.

    Written to `found` are all instants, with x and y, then of each step its number of instants, u, its
    success, and y at its end. See `closed_loop.compiled_run` for the other arguments.
    """
    (ends, grid), (refs, noise), (dead, late, seen, delayed) = times, signals, delays
    (slow, sizes), (memory, spans), (t, x, y, lengths, u_control, usable, y_end) = lag, room, found
    u, measured = memory[1][0], np.empty(y.shape[1])
    reached, farthest, parts = u.copy(), np.zeros(len(u)), np.zeros((3, len(u)))
    loop, dense, tolerance, at = (dead, system, memory, spans), (t, x), 0.0, 0
    for k in range(len(lengths)):
        if delayed:
            _seen(ends[k], tolerance, seen, system, spans, (t[at], x[at]), measured)
        else:
            _outputs(x[at], reached, k, system, measured)
        for i in range(len(measured)):
            measured[i] += noise[k, i]
        usable[k] = _decide(measured, refs[k], u, pids, wear, limits, u_control[k])
        u = u_control[k]
        lengths[k] = _write_instants(ends[k], ends[k + 1], grid, at + 1, t)
        after = at + lengths[k]
        split = _actuate(u, reached, farthest, t[after] - t[at], slow, sizes, parts)
        finite, stiff = _simulate(at, after, dense, k, split, parts, loop)
        if stiff:
            return 0
        tolerance = 1e-10 * (t[after] - t[at])
        for row in range(at, after + 1):
            out = y[row] if row < after else y_end[k]
            if delayed:
                _seen(t[row], tolerance, late, system, spans, (t[after], x[after]), out)
            else:
                _outputs(x[row], parts[2], k, system, out)
        at = after
        if not finite:
            return k + 1
    return len(lengths)
