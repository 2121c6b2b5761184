"""The unit cube as an agent sees it: many points at once, and points not tried before."""

from itertools import product

import numpy as np
from jaxtyping import Float

from prefcal_agents.models.rbf import squared_distances
from prefcal_env.errors import ProtocolError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .capacity import capacity, choices
from .feasible import Region, random_points

_DRAWS = 200  # random points looked at before an integer space is searched in full
_POOL, _POOL_SHARE = 200, 20  # allowed points to choose from: at least, and for each one chosen


def latin_hypercube(space: KnobSpace, count: int, seed: int) -> Float[np.ndarray, "N n"]:
    """`count` space-filling points of the cube, shape (count, n).

    Source: section IV of the paper: the start of GLISp.
    Deviation: plain, one point in each stratum. The paper's lhsdesign takes the best of five such
    plans by their smallest distance between two points. Measured in docs/deviations.md.
    """
    from scipy.stats import qmc  # takes most of a second to import

    sampler = qmc.LatinHypercube(len(space), rng=np.random.default_rng([seed, 0]))
    points = space.scaled(np.asarray(sampler.random(count), dtype=float))
    return _moved_inside(points, space, seed) if space.constraints else points


def _moved_inside(
    points: Float[np.ndarray, "N n"], space: KnobSpace, seed: int
) -> Float[np.ndarray, "N n"]:
    """Replace each point that the constraints refuse by an allowed one far from all others."""
    region = Region(space)
    refused = np.flatnonzero(~region.allows(points))
    if len(refused):
        pool = region.draw(
            max(_POOL, _POOL_SHARE * len(refused)), np.random.default_rng([seed, 0, 1])
        )
        nearest = squared_distances(pool, np.delete(points, refused, axis=0)).min(
            axis=1, initial=np.inf
        )
        for index in refused:
            farthest = int(np.argmax(nearest))
            points[index] = pool[farthest]
            nearest = np.minimum(nearest, squared_distances(pool, pool[farthest, None])[:, 0])
    return points


class Tried:
    """The θ that ran: none runs again, nor one that differs by less than a step in every knob.

    Args:
        space: The knobs.
        history: Samples and answers.
    """

    def __init__(self, space: KnobSpace, history: History) -> None:
        self._space = space
        tried = [sample.theta for sample in history.samples[: history.answered]]
        self._thetas = np.array(tried, dtype=float).reshape(-1, len(space))

    def __contains__(self, z: Float[np.ndarray, " n"]) -> bool:
        theta = self._space.decode(self._space.snap(z))
        return bool(self._space.close(theta, self._thetas).any())

    def may_run(self, z: Float[np.ndarray, " n"]) -> bool:
        """Return whether the θ of `z`, shape (n,), is a new one that the constraints allow."""
        return bool(self._space.allows(self._space.decode(self._space.snap(z)))) and z not in self

    def fresh(
        self, z: Float[np.ndarray, " n"], rng: np.random.Generator
    ) -> Float[np.ndarray, " n"]:
        """`z`, shape (n,), or if its θ ran already or is not allowed, another one's point.

        Random points are those of what is searched.

        Raises:
            ProtocolError: every θ of the space has been tried.
            KnobError: none was found that the constraints allow.
        """
        if self.may_run(z):
            return z
        for candidate in random_points(self._space, _DRAWS, rng):
            if self.may_run(candidate):
                return np.asarray(candidate)
        if not np.isfinite(capacity(self._space)):
            raise ProtocolError(f"no new θ was found in {_DRAWS} random draws")
        return self._first_free()

    def _first_free(self) -> Float[np.ndarray, " n"]:
        # Few θ are left, so the space is small: at most some times the number of samples.
        values = [choices(*each) for each in zip(self._space, self._space.within, strict=True)]
        for theta in product(*values):
            z = self._space.encode(np.array(theta, dtype=float))
            if self.may_run(z):
                return z
        raise ProtocolError(f"every one of the {len(self._thetas)} θ of the space has been tried")
