"""Where to simulate next: near the θ that lead by what is known."""

import numpy as np
from jaxtyping import Float

from prefcal_agents.space.feasible import Region
from prefcal_env.knobs.space import KnobSpace

_LEADERS = 20
"""Number of the best θ of a draw that span the step."""
_BASES = 3
"""Number of the best θ of a draw from which a step starts."""
_STEP = (0.2, 0.8)
"""Smallest and largest multiple of the difference of two leaders."""
_MOVED = 0.8
"""Probability that a knob moves along."""
_JITTER = 0.01
"""Standard deviation of a random step, in units of the cube, where all leaders agree."""


def near_leaders(
    space: KnobSpace,
    z: Float[np.ndarray, "m n"],
    costs: Float[np.ndarray, "s m"],
    count: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "count n"]:
    """Return points of the cube near the θ with the lowest costs, shape (count, n).

    Each point belongs to one draw: one of its best θ, plus a part of the difference of two of its
    leaders. So steps are long while leaders are far apart, and shrink with them.

    Source: R. Storn, K. Price, "Differential evolution" (1997).
    Deviation: the population is the leaders of one draw, and all simulated θ can be leaders.

    Args:
        space: Knobs to tune.
        z: Simulated points of the cube, shape (m, n).
        costs: Their costs in each draw, shape (s, m).
        count: Number of points.
        rng: Generator of the draws.
    """
    leaders = np.argsort(costs, axis=1, kind="stable")[:, :_LEADERS]
    drawn = leaders[rng.integers(len(leaders), size=count)]
    first = drawn[np.arange(count), rng.integers(min(_BASES, drawn.shape[1]), size=count)]
    pair = np.array([rng.choice(row, 2) for row in drawn])
    step = rng.uniform(*_STEP, (count, 1)) * (z[pair[:, 0]] - z[pair[:, 1]])
    step *= rng.random(step.shape) < _MOVED
    low, high = space.corners
    points = z[first] + step + _JITTER * rng.standard_normal(step.shape)
    points = np.where(points < low, 2 * low - points, points)  # reflected at the edge
    points = np.clip(np.where(points > high, 2 * high - points, points), low, high)
    if not space.constraints:
        return space.snap_all(points)
    region = Region(space)
    allowed = z[region.allows(z)]
    return region.repaired(points, allowed) if len(allowed) else space.snap_all(points)
