"""The smallest change that is as good as the result: its knobs are put back to where they were."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs.space import KnobSpace

_WORSE = 0.05
"""Probability of being noticeably worse than the result up to which a knob is put back."""


@dataclass(frozen=True, slots=True)
class SmallerChange:
    """The result with some of its knobs as they were.

    Args:
        theta: θ, physical.
        kept: Numbers of the knobs that are as they were, from 0.
        chance: Probability that it is noticeably worse than the result.
    """

    theta: tuple[float, ...]
    kept: tuple[int, ...]
    chance: float


def smaller_change(
    result: Float[np.ndarray, " n"],
    before: Float[np.ndarray, " n"],
    space: KnobSpace,
    chances: Callable[[Float[np.ndarray, "p n"]], Float[np.ndarray, " p"]],
) -> SmallerChange | None:
    """Return the result with knobs put back one after the other, the one noticed least first.

    None if not even one can be. It takes n (n + 1) / 2 values of `chances` or fewer.

    Args:
        result: Physical θ, shape (n,).
        before: θ that it replaces, shape (n,).
        space: Knobs, whose constraints hold for all that is tried.
        chances: Function of physical θ, shape (p, n), that returns how probably each is noticeably
            worse than the result, shape (p,).
    """
    theta, chance = result, 0.0
    while len(left := np.flatnonzero(theta != before)):
        tried = np.where(np.eye(len(theta), dtype=bool)[left], before, theta)
        tried = tried[np.atleast_1d(space.allows(tried))]
        found = chances(tried) if len(tried) else np.ones(1)
        first = int(np.argmin(found))
        if found[first] > _WORSE:
            break
        theta, chance = tried[first], float(found[first])
    if np.array_equal(theta, result):
        return None
    return SmallerChange(tuple(theta.tolist()), tuple(np.flatnonzero(theta == before).tolist()), chance)
