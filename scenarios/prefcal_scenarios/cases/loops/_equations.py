"""The plants of the family as compiled equations, which the MPC calls.

p is (n, kind, n_x, n_u, n_d, n_y), the disturbance (n_d,), the indices of the measured states
(n_y,), and the plant's parameters: n numbers in all.
"""

from typing import Any

import numba
import numpy as np

from prefcal_env.jit import inner
from prefcal_env.plants._calls import equation
from prefcal_env.plants.equations import Equations, compiled

from ._simulate import slopes
from .course import Course
from .plants import derivative, packed

carray: Any = numba.carray  # type: ignore[attr-defined]
_HEAD = 6


def equations_of(course: Course) -> Equations:
    """Return the equations of a loop's plant, with the disturbance at its value at the start."""
    kind, parameters = packed(course.plant)
    d = course.disturbance[0]
    rest = np.concatenate([d, course.measured, parameters])
    sizes = map(len, (course.x0, course.u0, d, course.measured))
    return compiled(f, g, jacobians, np.concatenate([[_HEAD + len(rest), kind, *sizes], rest]))


@inner()
def _parts(p):  # type: ignore[no-untyped-def]
    """Return the kind, the sizes, and d, the measured states and the parameters."""
    n_d, n_y = int(p[4]), int(p[5])
    numbers, after = carray(p, (int(p[0]),)), _HEAD + n_d + n_y
    arrays = numbers[_HEAD : _HEAD + n_d], numbers[_HEAD + n_d : after], numbers[after:]
    return int(p[1]), (int(p[2]), int(p[3])), arrays


@equation()
def f(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ."""
    kind, (n_x, n_u), (own_d, _, own_p) = _parts(p)
    derivative(kind, own_p, carray(x, (n_x,)), carray(u, (n_u,)), own_d, carray(out, (n_x,)))


@equation()
def g(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write the measured states."""
    _, _, (_, measured, _) = _parts(p)
    for i in range(len(measured)):
        out[i] = x[int(measured[i])]


@equation()
def jacobians(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write A and B, by central differences, C and D = 0."""
    kind, (n_x, n_u), (own_d, measured, own_p) = _parts(p)
    A, B = slopes(kind, own_p, carray(x, (n_x,)).copy(), carray(u, (n_u,)).copy(), own_d)
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
