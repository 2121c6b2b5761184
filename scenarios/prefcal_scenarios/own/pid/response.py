"""How a linear loop with a given tuning answers a step and a load."""

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.rules import Tuning
from prefcal_env.controllers.sampled import Sampled

_SETTLED = 0.02


def responses(
    plant: Sampled, tuning: Tuning, N: float, count: int
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the outputs after a unit step of the reference and of the load, each (count,)."""
    outputs = np.zeros((2, count))
    for row, (r, w) in enumerate(((1.0, 0.0), (0.0, 1.0))):
        x, integral, derivative, before = np.zeros(len(plant.A)), 0.0, 0.0, 0.0
        share = tuning.T_d / (tuning.T_d + N * plant.T_s)
        for k in range(count):
            y = float(plant.C[0] @ x)
            outputs[row, k] = y
            derivative = share * (derivative - tuning.K_p * N * (y - before))
            u = tuning.K_p * (r - y) + integral + derivative
            integral += tuning.K_p * plant.T_s / tuning.T_i * (r - y)
            before = y
            x = plant.A @ x + plant.B[:, 0] * (u + w)
    return outputs[0], outputs[1]


def settling(plant: Sampled, tuning: Tuning, N: float) -> tuple[float, float]:
    """Return the time until step and load have settled, and the peak of the load's output.

    Raises:
        FloatingPointError: If the loop does not settle.
    """
    count = 200
    while count <= 25_600:
        step, load = responses(plant, tuning, N, count)
        if not np.isfinite(step).all():
            break
        peak = float(np.abs(load).max())
        late = np.flatnonzero((np.abs(step - 1) > _SETTLED) | (np.abs(load) > 5 * _SETTLED * peak))
        last = int(late[-1]) if len(late) else 0
        if last < 0.7 * count:
            return (last + 1) * plant.T_s, peak
        count *= 2
    raise FloatingPointError("the loop does not settle")
