"""A reference or a disturbance that steps: what most tasks need, as data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Values = Sequence[float] | np.ndarray
"""The n values of a signal."""


@dataclass(frozen=True, slots=True)
class StepSignal:
    """A signal that is constant between steps; of a time it is a function, as `Task` takes it.

    Args:
        start: Values until the first step, n numbers.
        steps: Later times, increasing, each with the n values from then on.
    """

    start: Values
    steps: tuple[tuple[float, Values], ...] = ()

    def __call__(self, t: float) -> Float[np.ndarray, " n"]:
        """Return the values at time `t`, shape (n,)."""
        now = self.start
        for time, values in self.steps:
            if t >= time:
                now = values
        return np.asarray(now, dtype=float)

    def over(self, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n"]:
        """Return the values at the times `t`, shape (K, n)."""
        found = np.tile(np.asarray(self.start, dtype=float), (len(t), 1))
        for time, values in self.steps:
            found[t >= time] = values
        return found
