"""How long a linear loop takes to settle after a step and a load."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

_SETTLED = 0.02
Responses = Callable[[int], tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]]
"""Function of a number of samples: the outputs after a unit step of reference and load."""


def settling(responses: Responses, T_s: float) -> tuple[float, float]:
    """Return the time until step and load have settled, and the peak of the load's output.

    Raises:
        FloatingPointError: If the loop does not settle.
    """
    count = 200
    while count <= 25_600:
        step, load = responses(count)
        if not np.isfinite(step).all():
            break
        peak = float(np.abs(load).max())
        late = np.flatnonzero((np.abs(step - 1) > _SETTLED) | (np.abs(load) > 5 * _SETTLED * peak))
        last = int(late[-1]) if len(late) else 0
        if last < 0.7 * count:
            return (last + 1) * T_s, peak
        count *= 2
    raise FloatingPointError("the loop does not settle")
