"""Create the initial design: a Latin hypercube."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist

from prefcal_env.knobs.space import KnobSpace

from .feasible import Region

_POOL, _POOL_SHARE = 200, 20  # allowed points to choose from: at least, and for each one chosen


def latin_hypercube(space: KnobSpace, count: int, seed: int) -> Float[np.ndarray, "N n"]:
    """Return `count` space-filling points of the cube, shape (count, n).

    Source: section IV of the paper: the start of GLISp.
    Deviation: a plain design, one point in each stratum. The paper's lhsdesign takes the best of
    five such designs by their smallest distance between two points. Measured in docs/deviations.md.
    """
    # The same points as scipy.stats.qmc.LatinHypercube, which takes 0.4 s to import.
    rng = np.random.default_rng([seed, 0]).spawn(1)[0]
    within = rng.uniform(size=(count, len(space)))
    strata = np.array([rng.permutation(count) for _ in range(len(space))]).T
    points = space.scaled((strata + 1 - within) / count)
    return _moved_inside(points, space, seed) if space.constraints else points


def _moved_inside(points: Float[np.ndarray, "N n"], space: KnobSpace, seed: int) -> Float[np.ndarray, "N n"]:
    """Replace each point that the constraints refuse by an allowed one far from all others."""
    region = Region(space)
    refused = np.flatnonzero(~region.allows(points))
    if len(refused):
        pool = region.draw(max(_POOL, _POOL_SHARE * len(refused)), np.random.default_rng([seed, 0, 1]))
        nearest = cdist(pool, np.delete(points, refused, axis=0), "sqeuclidean").min(axis=1, initial=np.inf)
        for index in refused:
            farthest = int(np.argmax(nearest))
            points[index] = pool[farthest]
            nearest = np.minimum(nearest, cdist(pool, pool[farthest, None], "sqeuclidean")[:, 0])
    return points
