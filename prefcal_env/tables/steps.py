"""Find the steps of time that are no steps forward, or gaps, and say where they are."""

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.wording import and_more

MAX_GAP = 10.0
"""Longest step of time that is no gap, in median steps."""


def steps_back(t: Float[np.ndarray, " K"]) -> Int[np.ndarray, " M"]:
    """Return each row, from 0, whose successor is not later."""
    with np.errstate(over="ignore"):
        return np.flatnonzero(np.diff(t) <= 0)


def gaps(t: Float[np.ndarray, " K"], longest: float = MAX_GAP) -> Int[np.ndarray, " M"]:
    """Return each row, from 0, that a gap follows: a step above `longest` median steps."""
    with np.errstate(over="ignore"):
        return np.flatnonzero(np.diff(t) > longest * _usual(t))


def step_back_words(t: Float[np.ndarray, " K"], k: int, unit: str, count: int) -> str:
    """Return what is wrong with the step of time after row k, the first of `count`."""
    return f"time must increase, got {t[k + 1]:g} {unit} after {t[k]:g} {unit}{and_more(count)}"


def gap_words(t: Float[np.ndarray, " K"], k: int, unit: str, count: int) -> str:
    """Return which gap follows row k, the first of `count`."""
    return (
        f"a gap of {t[k + 1] - t[k]:g} {unit} after {t[k]:g} {unit}, where {_usual(t):g} {unit} "
        f"is usual{and_more(count)}"
    )


def _usual(t: Float[np.ndarray, " K"]) -> float:
    """Return the median step; 0 without steps."""
    return float(np.median(np.diff(t))) if len(t) > 1 else 0.0
