"""How compiled kernels call the equations of a plant, and the Runge-Kutta method that integrates them."""

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic

from prefcal_env.jit import callback, inlined, inner, kernel

# --- How compiled kernels call the equations of a plant: through the addresses of C functions.
#
# So one kernel serves every plant, and is compiled once. `void f(x, u, d, p, out)`, all pointers to
# doubles, writes ẋ, y, or the matrices A, B, C, D (row by row, one after the other) to `out`.

_POINTER = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
_intrinsic: Any = intrinsic

SIGNATURE = types.void(_POINTER, _POINTER, _POINTER, _POINTER, _POINTER)  # type of an equation

equation = partial(callback, SIGNATURE)
"""Decorator, used as `@equation()`, that compiles one equation of a plant."""


@_intrinsic
def call(typing: Any, address: Any, x: Any, u: Any, d: Any, p: Any, out: Any) -> Any:
    """Call the equation at `address` with the data of five arrays."""
    arrays = (x, u, d, p, out)
    if any(array.layout != "C" for array in arrays):
        raise TypingError("the arrays of an equation must be contiguous")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        double = ir.DoubleType().as_pointer()
        function = ir.FunctionType(ir.VoidType(), [double] * len(arrays)).as_pointer()
        data = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(signature.args[1:], values[1:], strict=True)
        ]
        builder.call(builder.inttoptr(values[0], function), data)
        return context.get_dummy_value()

    return types.void(address, *arrays), generate


# --- The Runge-Kutta method of order 8 by Dormand and Prince, compiled once for all plants.
#
# Source: Hairer, Nørsett, Wanner, "Solving Ordinary Differential Equations I" (1993), section II.5:
# DOP853 with its errors of order 5 and 3, its dense output of order 7, and its test of stiffness.
# Deviation: the first step is the whole interval, which has to pass the test of the error; periods of a
# controller are often that short, and no derivative has to be estimated.
#
# The coefficients are those of scipy, which takes half a second to import:
#
#     from scipy.integrate import DOP853 as D
#     table = np.zeros((22, 16))
#     table[:12, :12], table[12, :12], table[13:16] = D.A, D.B, D.A_EXTRA
#     table[16, :13], table[17, :13], table[18:] = D.E5, D.E3, D.D
#     np.save("dop853.npy", table)

TABLE = np.load(Path(__file__).with_name("dop853.npy"))
"""Constant for numba, which does not notice if the file changes: change this one, too.

Rows: 0 to 11 stages, 12 the result, 13 to 15 stages of the dense output, 16 and 17 the errors
of order 5 and 3, 18 to 21 the dense output."""

RELATIVE, ABSOLUTE = 1e-10, 1e-12  # tolerances of the error of a step, relative to a state and absolute
JUMPS = 30
"""Steps rejected twice, less 3 % of those accepted, from which on the equations are taken to jump
again and again, as with dry friction: then steps of a thousandth of the interval are accepted."""
STEPS = 100_000
"""Steps of the whole interval from which on its equations are taken to jump, too: then steps of a
thousandth are accepted for the rest. Judged by the time that the last 2 `MANY` steps took."""
MANY = 1000  # steps to go from which on stiff equations are left to an implicit method; also, see `JUMPS`
SMALLEST = 1e-14
"""Smallest step, relative to the interval. If it is not precise, the equations jump or blow up."""


@kernel()
def integrate(f, x, u, d, p, times, max_step, explicit):  # type: ignore[no-untyped-def]
    """Return the states at `times`, shape (K, n_x), and whether the equations are too stiff.

    States that are not reached are NaN: they blew up, or f is not finite there.

    Args:
        f: Address of the equation of ẋ, whose arguments are x, u, d and p.
        x: State at time 0 (n_x,).
        u: Inputs (n_u,); `d`, `p`: disturbances and parameters.
        times: Increasing instants (K,).
        explicit: Whether to go on although the equations are too stiff.
    """
    n, count = len(x), len(times)
    out = np.full((count, n), np.nan)
    k, y, dense = np.zeros((16, n)), np.zeros((16, n)), np.zeros((7, n))
    now, end, done = 0.0, times[count - 1] if count else 0.0, _start(times, x, out)
    h, grow, jumps, stiff = min(end, max_step), 10.0, 0.0, 0.0
    error, floor, limit, mark = math.nan, 0.0, math.inf, 0.0
    _copy(x, y[0])
    call(f, y[0], u, d, p, k[0])
    for i in range(1, STEPS + 10 * MANY):
        tiny, slow = not h > SMALLEST * end, False
        if i % (2 * MANY) == 0:
            slow, mark = now - mark < 2 * MANY / STEPS * end, now
        if done == count or (tiny and not _jumps(error, h, k, y)):
            break
        if tiny or slow:
            floor, h = end / MANY, min(end / MANY, end - now, max_step)
            limit = min(limit, 1000 * (_largest(y[0]) + end * _largest(k[:12].ravel())))
        least = end / MANY if jumps > JUMPS else floor
        after = now + h if end - now - h > 10 * SMALLEST * end else end
        error = _step(f, h, k, y, u, d, p)
        good = error < 1 or (h <= least and error < math.inf)
        if good and (after < end or times[done] < after):
            good = _ends(f, k, y, u, d, p)
        if not good:
            jumps += 1.0 if grow == 1.0 and error < math.inf else 0.0
            h, grow = h * (max(_change(error), 0.1) if 1 <= error < math.inf else 0.1), 1.0
            continue
        if floor > 0 and not _largest(y[12]) < limit:
            break
        if times[done] < after:
            _interpolate(f, h, k, y, u, d, p, dense)
        done = _write(times, done, now, after, h, y, dense, out)
        stiff = stiff + 1.0 if _ratio(h, k, y) > 6.1 else max(stiff - 0.25, 0.0)
        if stiff > 15 and end - after > MANY * h and not explicit:
            return out, True
        _advance(k, y)
        h = _fitted(max(h * min(_change(error), grow), least), max_step, end - after)
        now, grow, jumps = after, 10.0, max(jumps - 0.03, 0.0)
    return out, False


@inlined()
def _ends(f, k, y, u, d, p):  # type: ignore[no-untyped-def]
    """Write the rate at the end of a step to k[12], and return whether it is finite."""
    call(f, y[12], u, d, p, k[12])
    return _largest(k[12]) < math.inf


@inner()
def _advance(k, y):  # type: ignore[no-untyped-def]
    """Start the next step at the end of this one."""
    _copy(y[12], y[0])
    _copy(k[12], k[0])


@inner()
def _fitted(h, max_step, left):  # type: ignore[no-untyped-def]
    """Return a step h that is not too long, and leaves no tiny rest of the interval."""
    h = min(h, max_step)
    return min(left, max_step) if left < 1.01 * h else h


@inner()
def _change(error):  # type: ignore[no-untyped-def]
    """Return the factor from a step with this error to one that is precise enough."""
    return 0.9 * max(error, 1e-16) ** -0.125


@inlined()
def _jumps(error, h, k, y):  # type: ignore[no-untyped-def]
    """Return whether equations for which no step is small enough jump; else they blow up.

    Before a jump, the smallest step changes the states by little more than the tolerance; before
    they blow up, by a good part of them.
    """
    if not error < math.inf:
        return False
    for i in range(y.shape[1]):  # noqa: SIM110 (compiled: no generator)
        if not h * abs(k[0, i]) < 1e4 * (ABSOLUTE + RELATIVE * abs(y[0, i])):
            return False
    return True


@inner()
def _largest(values):  # type: ignore[no-untyped-def]
    """Return the largest absolute value, or NaN if there is a NaN."""
    largest = 0.0
    for value in values:
        if largest >= 0 and not abs(value) <= largest:
            largest = abs(value)
    return largest


@inlined()
def _step(f, h, k, y, u, d, p):  # type: ignore[no-untyped-def]
    """Write the stages of a step h to `k`, the result to y[12], and return the error."""
    n = y.shape[1]
    for s in range(1, 12):
        _stage(s, h, k, y)
        call(f, y[s], u, d, p, k[s])
    _stage(12, h, k, y)
    fifth, third = 0.0, 0.0
    for i in range(n):
        scale = ABSOLUTE + RELATIVE * max(abs(y[0, i]), abs(y[12, i]))
        fifth += (_weighted(16, 12, k, i) / scale) ** 2
        third += (_weighted(17, 12, k, i) / scale) ** 2
    if fifth == 0:
        return 0.0
    return h * fifth / math.sqrt((fifth + 0.01 * third) * n)


@inner()
def _stage(s, h, k, y):  # type: ignore[no-untyped-def]
    """Write the state of stage `s` to y[s]."""
    for i in range(y.shape[1]):
        y[s, i] = y[0, i] + h * _weighted(s, s, k, i)


@inner()
def _weighted(row, m, k, i):  # type: ignore[no-untyped-def]
    """Return the sum of the first m stages of state i with the weights of a row of the table."""
    total = 0.0
    for j in range(m):
        total += TABLE[row, j] * k[j, i]
    return total


@inlined()
def _ratio(h, k, y):  # type: ignore[no-untyped-def]
    """Return h times a lower bound of the fastest rate: both stages are at the end of the step."""
    above, below = 0.0, 0.0
    for i in range(y.shape[1]):
        above += (k[12, i] - k[11, i]) ** 2
        below += (y[12, i] - y[11, i]) ** 2
    return h * math.sqrt(above / below) if below > 0 else 0.0


@inlined()
def _interpolate(f, h, k, y, u, d, p, dense):  # type: ignore[no-untyped-def]
    """Write the coefficients of the dense output of a step to `dense`."""
    for s in range(13, 16):
        _stage(s, h, k, y)
        call(f, y[s], u, d, p, k[s])
    for i in range(y.shape[1]):
        change = y[12, i] - y[0, i]
        dense[0, i] = change
        dense[1, i] = h * k[0, i] - change
        dense[2, i] = 2 * change - h * (k[0, i] + k[12, i])
        for j in range(4):
            dense[3 + j, i] = h * _weighted(18 + j, 16, k, i)


@inlined()
def _start(times, x, out):  # type: ignore[no-untyped-def]
    """Write the state at times of 0, and return their number."""
    done = 0
    while done < len(times) and times[done] <= 0:
        _copy(x, out[done])
        done += 1
    return done


@inlined()
def _write(times, done, now, after, h, y, dense, out):  # type: ignore[no-untyped-def]
    """Write the states at the times up to the end of a step, and return the number of all."""
    while done < len(times) and times[done] <= after:
        if times[done] < after:
            _read((times[done] - now) / h, y[0], dense, out[done])
        else:
            _copy(y[12], out[done])
        done += 1
    return done


@inlined()
def _read(s, x, dense, out):  # type: ignore[no-untyped-def]
    """Write the state at the fraction `s` of a step from x to `out`."""
    for i in range(len(x)):
        total = 0.0
        for j in range(6, -1, -1):
            total = (total + dense[j, i]) * (s if j % 2 == 0 else 1 - s)
        out[i] = x[i] + total


@inner()
def _copy(source, target):  # type: ignore[no-untyped-def]
    for i in range(len(source)):
        target[i] = source[i]
