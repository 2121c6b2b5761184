"""Checks of the values that a caller passes to an environment."""

from collections.abc import Mapping, Sequence
from math import isfinite, isnan
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import numbers
from prefcal_env.errors import PlantError, SettingsError


def vector(value: Any, n: int, what: str, *, finite: bool = True) -> Float[np.ndarray, " n"]:
    """Return `value` as an array of shape (n,).

    Raises PlantError if it is not numeric, has the wrong shape, or is NaN or (if `finite`)
    infinite.
    """
    array = numbers(value, what, PlantError)
    if array.shape != (n,):
        raise PlantError(f"{what} must have shape ({n},), got {array.shape}")
    values = array.tolist()  # a few numbers: faster than array operations
    if not all(map(isfinite, values)) if finite else any(map(isnan, values)):
        raise PlantError(f"{what} must be finite, got {array}")
    return array


def number(value: Any, limits: tuple[float, float], what: str) -> float:
    """Return `value` as a float. Raises SettingsError if it is no number or outside `limits`."""
    numeric = isinstance(value, (int, float, np.integer, np.floating))
    low, high = limits
    if not numeric or isinstance(value, bool) or not low <= value <= high:
        raise SettingsError(f"{what} must be a number in [{low}, {high}], got {value!r}")
    return float(value)


def known_options(given: Mapping[str, Any] | None, known: Sequence[str]) -> dict[str, Any]:
    """Return the options of a `reset` as a dict.

    Raises SettingsError if they are no mapping, or for an unknown one.
    """
    if not isinstance(given, Mapping | None):
        raise SettingsError(f"reset options must be a dict, got {given!r}")
    options = dict(given or {})
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise SettingsError(f"reset options must be among {tuple(known)}, got {unknown}")
    return options
