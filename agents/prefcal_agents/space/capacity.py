"""Count the different θ of a space."""

from math import prod

import numpy as np

from prefcal_env.errors import KnobError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace

_COUNTED = 100_000  # spaces with at most this many θ are checked against the constraints
_MANY = 10**6  # a knob with more values counts as having no step


def capacity(space: KnobSpace) -> float:
    """Return the number of different θ to search; infinite if a knob has no step.

    In a small space, θ that the constraints refuse are not counted.

    Raises:
        KnobError: If the space is small and the constraints allow no θ.
    """
    counts = [_count(knob, *part) for knob, part in zip(space, space.within, strict=True)]
    total = prod(counts)
    if not space.constraints or total > _COUNTED:
        return float(total)
    every = np.meshgrid(
        *(knob.choices(*part) for knob, part in zip(space, space.within, strict=True)), indexing="ij"
    )
    allowed = np.count_nonzero(space.allows(np.stack(every, axis=-1).reshape(-1, len(space))))
    if not allowed:
        names = [constraint.name for constraint in space.constraints]
        raise KnobError(f"the constraints {names} allow none of the {total:.0f} θ of the space")
    return float(allowed)


def _count(knob: Knob, low: float, high: float) -> float:
    if low == high:
        return 1
    if knob.resolution == 0:
        return np.inf
    first, last = knob.steps(np.array([low, high]))
    return np.inf if last - first > _MANY else len(knob.choices(low, high))
