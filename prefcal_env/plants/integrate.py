"""A fixed-step integrator, written so that it runs in Python and also compiles."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float


def integrate(
    f: Callable[[Any, Any, Any], Any],
    x: Float[np.ndarray, " n_x"],
    u: Float[np.ndarray, " n_u"],
    d: Float[np.ndarray, " n_d"],
    times: Float[np.ndarray, " K"],
    max_step: float,
) -> Float[np.ndarray, "K n_x"]:
    """Return the states at `times` after `x` at time 0, with `u` and `d` held, shape (K, n_x).

    Uses the classical Runge-Kutta method of order 4. Each interval between two of `times` is
    divided into equal steps of at most `max_step`, so that each of `times` is hit exactly.

    A plant that compiles `f` also compiles this function (see `_cstr_kernels`): use only what
    numba supports.
    """
    states = np.empty((len(times), len(x)))
    now = 0.0
    for i in range(len(times)):
        n_steps = max(1, int(np.ceil((times[i] - now) / max_step - 1e-9)))
        h = (times[i] - now) / n_steps
        for _ in range(n_steps):
            k1 = f(x, u, d)
            k2 = f(x + h / 2 * k1, u, d)
            k3 = f(x + h / 2 * k2, u, d)
            k4 = f(x + h * k3, u, d)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        for j in range(len(x)):  # assigning the whole row would take 3 s to compile
            states[i, j] = x[j]
        now = times[i]
    return states
