"""Compiled right-hand side and simulation of the CSTR.

In Python one experiment of 48 h takes about 25 times as long. numba keeps the compiled code beside
this file and checks only this file to see whether it is stale: after a change of `integrate.py`,
touch this one.
"""

import math

import numba
import numpy as np

from prefcal_env.jit import kernel

from .integrate import integrate

_integrate = numba.njit(integrate, inline="always")


@kernel()
def rhs(x, u, d):  # type: ignore[no-untyped-def]
    """Return ẋ of eq. cstr_system_eqn; `d` is (T_f, C_Af) followed by the parameters."""
    T, C_A = x
    T_f, C_Af, F_V, k_0, H, E, rho_Cp, US_V, R = d
    r = k_0 * math.exp(-E / (R * T)) * C_A if T > 0 else 0.0
    out = np.empty(2)
    out[0] = F_V * (T_f - T) + H / rho_Cp * r - US_V / rho_Cp * (T - u[0])
    out[1] = F_V * (C_Af - C_A) - r
    return out


@kernel()
def hold(x, u, d, times, max_step):  # type: ignore[no-untyped-def]
    """Run `integrate` with `rhs`."""
    return _integrate(rhs, x, u, d, times, max_step)
