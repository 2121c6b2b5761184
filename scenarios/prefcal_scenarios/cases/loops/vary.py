"""Parameters of a loop: nominal for the named loops, drawn around that for random ones."""

from collections.abc import Callable

import numpy as np

Vary = Callable[[float], float]
"""Function that returns the value to use in place of a positive nominal one."""

_FACTOR = 1.5
"""Random parameters lie between the nominal value divided and multiplied by this."""


def nominal(value: float) -> float:
    """Return `value` itself."""
    return value


def random(rng: np.random.Generator) -> Vary:
    """Return a function that draws values around the nominal one, uniform in the logarithm."""

    def vary(value: float) -> float:
        return float(value * _FACTOR ** rng.uniform(-1.0, 1.0))

    return vary
