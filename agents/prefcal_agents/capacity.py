"""How many different θ a space holds."""

from math import prod

import numpy as np

from prefcal_env.errors import KnobError
from prefcal_env.knobs import KnobSpace

_COUNTED = 100_000  # θ of an integer space up to which those that are allowed are counted


def capacity(space: KnobSpace) -> float:
    """How many different θ are searched; infinite unless all knobs are integers, or frozen.

    Those that constraints refuse are left out, where all can be looked at.

    Raises:
        KnobError: all were looked at, and none is allowed.
    """
    if not all(knob.integer or frozen for knob, frozen in zip(space, space.frozen, strict=True)):
        return np.inf
    total = prod(int(high - low) + 1 for low, high in space.within)
    if not space.constraints or total > _COUNTED:
        return float(total)
    every = np.meshgrid(
        *(low + np.arange(int(high - low) + 1) for low, high in space.within), indexing="ij"
    )
    allowed = np.count_nonzero(space.allows(np.stack(every, axis=-1).reshape(-1, len(space))))
    if not allowed:
        names = [constraint.name for constraint in space.constraints]
        raise KnobError(f"the constraints {names} allow none of the {total} θ of the space")
    return float(allowed)
