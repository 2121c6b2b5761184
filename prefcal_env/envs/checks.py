"""Checks of what a caller hands to an environment."""

from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError, SettingsError


def vector(value: Any, n: int, what: str, *, finite: bool = True) -> Float[np.ndarray, " n"]:
    """`value` as an array of shape (n,). Raises PlantError: wrong shape, NaN or (unless) inf."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise PlantError(f"{what} must be {n} numbers, got {value!r}") from error
    if array.shape != (n,):
        raise PlantError(f"{what} must have shape ({n},), got {array.shape}")
    if np.any(np.isnan(array)) or (finite and not np.all(np.isfinite(array))):
        raise PlantError(f"{what} must be finite, got {array}")
    return array


def number(value: Any, limits: tuple[float, float], what: str) -> float:
    """`value` as a float. Raises SettingsError if it is no number, or outside `limits`."""
    numeric = isinstance(value, (int, float, np.integer, np.floating))
    low, high = limits
    if not numeric or isinstance(value, bool) or not low <= value <= high:
        raise SettingsError(f"{what} must be a number in [{low}, {high}], got {value!r}")
    return float(value)
