"""Draw what is random in an interview, from its seed: the sides, and which question repeats."""

import numpy as np

from prefcal_env.preferences.history import Comparison
from prefcal_env.study import State

_SIDES, _REPEATS = 11, 12
"""Streams of the study's seed; agents use other ones."""


def challenger_left(seed: int, challenger: int, further: int | None = None) -> bool:
    """Return whether the challenger is on the left: half of the time, reproducibly.

    `further` is the other experiment of a follow-up comparison.
    """
    pair = [challenger] if further is None else [challenger, further]
    return bool(np.random.default_rng([seed, *pair, _SIDES]).random() < 0.5)


def to_repeat(state: State, seed: int) -> Comparison | None:
    """Return an earlier question with a verdict that has not been repeated yet, or None."""
    done = {c.repeats for c in state.history.repeats}
    left = [
        c
        for c in state.history.counting
        if c.question is not None
        and c.question not in done
        and not c.retracted
        and c.answer.preference is not None
    ]
    # Not the very last one, which people remember, unless there is no other.
    left = left[:-1] if len(left) > 1 and left[-1] is state.history.comparisons[-1] else left
    if not left:
        return None
    rng = np.random.default_rng([seed, len(state.history.repeats), _REPEATS])
    return left[int(rng.integers(len(left)))]
