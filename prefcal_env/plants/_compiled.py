"""C functions from equations that somebody compiled with `numba.njit`."""

from functools import cache
from typing import Any

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from prefcal_env.errors import PlantError
from prefcal_env.jit import inner

from ._dop853 import SIGNATURE, call
from .plant import Equations, compiled

_STEP = 1e-3  # step of the differences, as in `derivative`
carray: Any = numba.carray  # type: ignore[attr-defined]


def all_compiled(f: Any, g: Any) -> bool:
    """Return whether numba compiles f, and g if it is given."""
    return all(isinstance(e, Dispatcher) for e in (f, g) if e is not None)


def equations_of(f: Any, g: Any, sizes: tuple[int, int, int, int]) -> Equations:
    """Return the equations ẋ = f(x, u, d) and y = g(x, u, d), or y = x if `g` is None.

    `sizes` are the numbers of states, inputs, disturbances and outputs.
    """
    return compiled(*_functions(f, g, sizes), np.zeros(0))


@cache  # forever: who holds an address does not hold the function
def _functions(f: Any, g: Any, sizes: tuple[int, int, int, int]) -> tuple[Any, Any, Any]:
    rates = _function(f, sizes[0], sizes)
    outputs = _function(g, sizes[3], sizes) if g is not None else None
    addresses = rates.address, 0 if outputs is None else outputs.address
    return rates, outputs, _jacobians(*addresses, sizes)


def _function(function: Any, size: int, sizes: tuple[int, int, int, int]) -> Any:
    n_x, n_u, n_d, _ = sizes

    def write(x, u, d, p, out):  # type: ignore[no-untyped-def]
        for i in range(size):
            out[i] = np.nan  # stays if the function raises or returns another number of values
        try:
            x_, u_, d_ = carray(x, (n_x,)), carray(u, (n_u,)), carray(d, (n_d,))
            values = function(x_.copy(), u_.copy(), d_.copy())  # it may write into them
            if len(values) == size:
                for i in range(size):
                    out[i] = values[i]
        except Exception:
            return

    try:
        return numba.cfunc(SIGNATURE)(write)
    except NumbaError as error:
        lines = [line for line in str(error).splitlines() if not line.startswith("Failed in")]
        raise PlantError(
            f"equation {function.__name__!r} must compile and return an array or a tuple of "
            f"{size} floats (write 1.0, not 1): {''.join(lines[:1])[:150]}"
        ) from error


def _jacobians(f: int, g: int, sizes: tuple[int, int, int, int]) -> Any:
    n_x, n_u, n_d, n_y = sizes
    total = (n_x + n_y) * (n_x + n_u)

    def write(x, u, d, p, out):  # type: ignore[no-untyped-def]
        both, d_ = (carray(x, (n_x,)).copy(), carray(u, (n_u,)).copy()), carray(d, (n_d,))
        matrices = carray(out, (total,))
        _differences(f, both, d_, n_x, matrices, 0)
        start = n_x * (n_x + n_u)
        if g:
            _differences(g, both, d_, n_y, matrices, start)
        else:  # y = x
            matrices[start:] = 0.0
            for i in range(n_x):
                matrices[start + i * (n_x + 1)] = 1.0

    return numba.cfunc(SIGNATURE)(write)


@inner()
def _differences(f, both, d, m, out, start):  # type: ignore[no-untyped-def]
    """Write ∂f/∂x and ∂f/∂u from `start` on: central differences, extrapolated to order 4."""
    x, u = both
    values = np.zeros((4, m))
    for i in range(len(x) + len(u)):
        point, j = (x, i) if i < len(x) else (u, i - len(x))
        here, first = point[j], start + j if i < len(x) else start + m * len(x) + j
        h = _STEP * max(abs(here), 1.0)
        for s in range(4):
            point[j] = here + h * (1 - 2 * (s % 2)) / (1 + s // 2)
            call(f, x, u, d, d, values[s])
        point[j] = here
        for r in range(m):
            coarse, fine = values[0, r] - values[1, r], values[2, r] - values[3, r]
            out[first + r * len(point)] = (8 * fine - coarse) / (6 * h)
