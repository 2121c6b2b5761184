"""How plants are simulated: by a compiled adaptive integrator, or if they are stiff by scipy's."""

import ctypes
import warnings
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from .equations import Equations
from .jacobians import D, States, Times, U, X

_EVALUATIONS = 10_000
"""Evaluations of ẋ after which the implicit method gives up."""


def integrate(equations: Equations, x: X, u: U, d: D, times: Times, max_step: float = np.inf) -> States:
    """Return the states at `times` after `x` at time 0, with `u` and `d` held, shape (K, n_x).

    Once a state blows up, it is NaN. The error of a step is below 1e-10 of each state or 1e-12;
    other instants change a state by no more than that. Stiff equations are left to an implicit
    method if the explicit one would need more than a thousand steps. Where equations jump again and
    again, as with dry friction, a thousandth of the interval is the smallest step; also for the
    rest of an interval that would take more than 100,000 steps.
    """
    explicit = _dop853().integrate
    # Copies: a read-only array is another type, for which numba compiles again.
    arrays = tuple(np.array(v, dtype=float) for v in (x, u, d, equations.parameters, times))
    states, stiff = explicit(equations.f, *arrays, max_step, False)
    if stiff:
        states = _implicit(max_step, equations.f, *arrays)
    if states is None:
        states, _ = explicit(equations.f, *arrays, max_step, True)
    return np.asarray(states)


@cache
def _dop853() -> Any:
    from . import _dop853  # imported here: load the compiler only when needed

    return _dop853


_Equation = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 5)


class _TooManyError(Exception):
    """The implicit method needs too many evaluations."""


def _implicit(
    max_step: float, f: int, x: X, u: U, d: D, p: Float[np.ndarray, " p"], times: Times
) -> States | None:
    """Return the states at `times` from backward differentiation, or None if it fails."""
    from scipy.integrate import solve_ivp  # takes half a second to import

    own = _dop853()
    call, fixed, evaluations = _Equation(f), [a.ctypes.data for a in (u, d, p)], 0

    def rate(_: float, x: X) -> X:
        nonlocal evaluations
        evaluations += 1
        if evaluations > _EVALUATIONS:
            raise _TooManyError
        point, out = np.array(x, dtype=float), np.empty(len(x))
        call(point.ctypes.data, *fixed, out.ctypes.data)
        return out

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # failure is told by `success`
            found = solve_ivp(
                rate,
                (0.0, times[-1]),
                x,
                "LSODA",
                times,
                rtol=own.RELATIVE,
                atol=own.ABSOLUTE,
                max_step=max_step,
            )
    except _TooManyError:
        return None
    return np.ascontiguousarray(found.y.T) if found.success else None
