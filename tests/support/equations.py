"""Evaluate the compiled equations of a plant from Python."""

import ctypes
from typing import Any

import numpy as np

from prefcal_env.plants.plant import Equations

_EQUATION = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 5)


def evaluated(equations: Equations, name: str, size: int, x: Any, u: Any, d: Any) -> np.ndarray:
    """Return the `size` numbers that the equation `name` writes."""
    arrays = [np.array(v, dtype=float) for v in (x, u, d, equations.parameters)]
    out = np.full(size, np.nan)
    _EQUATION(getattr(equations, name))(*(a.ctypes.data for a in (*arrays, out)))
    return out
