"""Reduce the rows of a long table: to a grid, or to what a plot and KPIs need."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import SettingsError

from .units import SECONDS


def period_of(resample: Any, unit: str) -> float:
    """Return a sampling period in `unit`, from a number or from text such as "0.1" or "100ms".

    Raises:
        SettingsError: If it is neither, or not above 0.
    """
    found = re.fullmatch(r"\s*(\d*\.?\d+(?:[eE][+-]?\d+)?)\s*([^\d\s]*)\s*", str(resample))
    value, given = (float(found[1]), found[2] or unit) if found else (0.0, unit)
    if given != unit:
        value = value * SECONDS[given] / SECONDS[unit] if {given, unit} <= set(SECONDS) else 0.0
    if not 0 < value < np.inf:
        raise SettingsError(
            f"resample must be a period above 0 {unit}, such as 0.1 or '100ms', got {resample!r}"
        )
    return value


def grid(t: Float[np.ndarray, " K"], period: float, most: int = 10_000_000) -> Float[np.ndarray, " M"]:
    """Return the multiples of `period` from the first of the instants `t` to the last one.

    Raises:
        SettingsError: If there are more than `most`.
    """
    count = (t[-1] - t[0]) / period
    if count > most:
        raise SettingsError(f"resample={period:g} makes {count:.3g} rows: give a longer period")
    return np.asarray(t[0] + period * np.arange(int(np.floor(count * (1 + 1e-12) + 1e-9)) + 1))


def extreme_rows(columns: Sequence[Float[np.ndarray, " K"]], most: int) -> Int[np.ndarray, " M"]:
    """Return at most `most` rows, which hold the extreme values of each stretch of each column.

    NaN is ignored.
    """
    count = len(columns[0])
    if count <= most:
        return np.arange(count)
    stretches = max((most - 2) // (2 * len(columns)), 1)
    starts = np.linspace(0, count, stretches + 1).astype(int)
    width = int(np.diff(starts).max())
    rows = np.minimum(starts[:-1, None] + np.arange(width), starts[1:, None] - 1)
    kept = [np.array([0, count - 1])]
    for values in columns:
        parts = values[rows]
        for fill, pick in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            best = pick(np.where(np.isnan(parts), fill, parts), axis=1)
            kept.append(rows[np.arange(stretches), best])
    found = np.unique(np.concatenate(kept))
    # Of many columns not all extremes can be kept: what is left out lies all over the run.
    return np.asarray(found[np.linspace(0, len(found) - 1, min(most, len(found))).astype(int)])
