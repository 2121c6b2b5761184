"""What chance decides in an interview, by seed alone: the sides, and what is asked again."""

import numpy as np

from prefcal_env.preferences.history import Comparison
from prefcal_env.study import State

_SIDES, _REPEATS = 11, 12
"""Streams of the study's seed; the agents' own are other ones."""


def challenger_left(seed: int, challenger: int, further: int | None = None) -> bool:
    """Whether the challenger of this index stands on the left: one half, and always the same.

    `further` is the other experiment where both were known before.
    """
    pair = [challenger] if further is None else [challenger, further]
    return bool(np.random.default_rng([seed, *pair, _SIDES]).random() < 0.5)


def to_repeat(state: State, seed: int) -> Comparison | None:
    """A question to ask again: an earlier one with a verdict, not repeated yet; None if none."""
    done = {c.repeats for c in state.history.repeats}
    left = [
        c
        for c in state.history.counting
        if c.question is not None
        and c.question not in done
        and not c.retracted
        and c.answer.preference is not None
    ]
    # Not the very last one, which he remembers, unless there is no other.
    left = left[:-1] if len(left) > 1 and left[-1] is state.history.comparisons[-1] else left
    if not left:
        return None
    rng = np.random.default_rng([seed, len(state.history.repeats), _REPEATS])
    return left[int(rng.integers(len(left)))]
