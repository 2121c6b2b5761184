"""The plants of the family as compiled equations, which the MPC calls.

p is (kind, n_x, n_u, n_d, n_y), the disturbance, the indices of the measured states, and the
parameters of the plant. numba checks only this file to see whether its compiled code is stale:
after a change of `_derivatives.py`, change this one.
"""

import numpy as np
from numba import carray

from prefcal_env.plants._calls import equation

from ._derivatives import derivative
from ._simulate import slopes

SIZES = 5


@equation()
def f(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ."""
    n_x, n_u, n_d, n_y = int(p[1]), int(p[2]), int(p[3]), int(p[4])
    numbers = carray(p, (SIZES + n_d + n_y + MOST,))
    derivative(
        int(p[0]), numbers[SIZES + n_d + n_y :], carray(x, (n_x,)), carray(u, (n_u,)),
        numbers[SIZES : SIZES + n_d], carray(out, (n_x,)),
    )  # fmt: skip
