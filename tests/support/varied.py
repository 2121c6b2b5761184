"""Closed loops with other parameters than the nominal ones."""

from collections.abc import Callable

import numpy as np


def random(rng: np.random.Generator) -> Callable[[float], float]:
    """Return what draws values around the nominal one, which makers of named loops take."""

    def vary(value: float) -> float:
        return float(value * 1.5 ** rng.uniform(-1.0, 1.0))

    return vary
