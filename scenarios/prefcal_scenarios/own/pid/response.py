"""How a linear loop with a given tuning answers a step and a load."""

import numpy as np

from prefcal_env.controllers.pid_law import LinearPIDs, Tuning
from prefcal_env.controllers.sampled import Sampled

_SETTLED = 0.02


def settling(plant: Sampled, tuning: Tuning, N: float) -> tuple[float, float]:
    """Return the time until step and load have settled, and the peak of the load's output.

    Raises:
        FloatingPointError: If the loop does not settle.
    """
    count, loop = 200, LinearPIDs.of([tuning], N)
    while count <= 25_600:
        step, load = loop.responses(plant, count)
        if not np.isfinite(step).all():
            break
        peak = float(np.abs(load).max())
        late = np.flatnonzero((np.abs(step - 1) > _SETTLED) | (np.abs(load) > 5 * _SETTLED * peak))
        last = int(late[-1]) if len(late) else 0
        if last < 0.7 * count:
            return (last + 1) * plant.T_s, peak
        count *= 2
    raise FloatingPointError("the loop does not settle")
