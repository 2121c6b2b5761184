"""Find points in the part of the unit cube that the constraints allow."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.distance import cdist

from prefcal_env.errors import KnobError
from prefcal_env.knobs.space import KnobSpace

_BLOCKS = (300, 1_000, 4_000, 16_000)  # numbers of random points to check, block by block
_LEADERS = 20  # points to search from if no random point is allowed
_AROUND = 30  # points to try around each of them at each step size
_STEPS = np.geomspace(0.3, 1e-5, 40)  # in units of the cube
_HALVINGS = 14  # bisections on the way to an allowed point
_ROUNDS = 3  # rounds of hit and run


@dataclass(frozen=True, slots=True)
class Region:
    """The points of the cube that the constraints of `space` allow, after snapping integers."""

    space: KnobSpace

    def allows(self, z: Float[np.ndarray, "m n"]) -> Bool[np.ndarray, " m"]:
        """Return whether the θ of each row of `z` is allowed, shape (m,)."""
        return np.asarray(self.space.allows(self._thetas(z)))

    def _thetas(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        return self.space.decode_all(self.space.snap_all(z, only_integers=True))

    def draw(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count n"]:
        """Return random points of the region, shape (count, n); uniform unless it is tiny.

        Raises:
            KnobError: If no allowed point was found.
        """
        n = len(self.space)
        found = np.zeros((0, n))
        for size in _BLOCKS:
            block = self.space.scaled(rng.random((max(size, count), n)))
            found = np.vstack([found, block[self.allows(block)]])
            if len(found) >= count:
                return np.asarray(found[:count])
        if not len(found):
            found = self._search(rng)
        for _ in range(_ROUNDS):
            found = np.vstack([found, self._beside(found, count, rng)])
        return found[-count:]

    def _beside(
        self, anchors: Float[np.ndarray, "a n"], count: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "count n"]:
        """Return points by hit and run: from random anchors part of the way to the edge."""
        start = anchors[rng.integers(len(anchors), size=count)]
        edge = self._toward(start, self.space.scaled(rng.random((count, start.shape[1]))))
        inside = start + rng.random((count, 1)) * (edge - start)
        return np.where(self.allows(inside)[:, None], inside, start)

    def _search(self, rng: np.random.Generator) -> Float[np.ndarray, "a n"]:
        """Return allowed points, found by reducing the violation of the constraints."""
        leaders = self.space.scaled(rng.random((_BLOCKS[-1], len(self.space))))
        sizes = np.nan_to_num(np.abs(self.space.excess(self._thetas(leaders))))
        scale = np.median(sizes, axis=0)
        order = np.argsort(self._violation(leaders, scale), kind="stable")
        leaders = leaders[order[:_LEADERS]]
        for step in _STEPS:
            shifts = step * rng.standard_normal((_LEADERS, _AROUND, len(self.space)))
            tries = np.concatenate([leaders[:, None], leaders[:, None] + shifts], axis=1)
            tries = np.clip(tries, *self.space.corners)
            flat = tries.reshape(-1, len(self.space))
            allowed = self.allows(flat)
            if allowed.any():
                return np.asarray(flat[allowed])
            violation = self._violation(flat, scale).reshape(_LEADERS, -1)
            leaders = tries[np.arange(_LEADERS), np.argmin(violation, axis=1)]
        raise KnobError(self._nothing(leaders[np.argmin(self._violation(leaders, scale))]))

    def _violation(
        self, z: Float[np.ndarray, "m n"], scale: Float[np.ndarray, " c"]
    ) -> Float[np.ndarray, " m"]:
        excess = self.space.excess(self._thetas(z)) / np.where(scale > 0, scale, 1.0)
        return np.asarray(np.sum(np.maximum(np.nan_to_num(excess, nan=1e9), 0.0), axis=1))

    def _nothing(self, nearest: Float[np.ndarray, " n"]) -> str:
        theta = self._thetas(nearest[None])
        excess = self.space.excess(theta)[0]
        violated = ", ".join(
            f"{constraint.name!r} is {g:g}"
            for constraint, g in zip(self.space.constraints, excess, strict=True)
            if not g <= 0
        )
        tries = sum(_BLOCKS) + _LEADERS * _AROUND * len(_STEPS)
        return (
            f"no θ was found that the constraints allow, in {tries} tries; each must be 0 or "
            f"less, but at the closest point, {self.space.named(theta[0])}, {violated}"
        )

    def repaired(
        self, z: Float[np.ndarray, "m n"], anchors: Float[np.ndarray, "a n"]
    ) -> Float[np.ndarray, "m n"]:
        """Return the rows of `z` snapped; rows that are not allowed move to the region's edge.

        They move toward the nearest of the anchors, which are allowed points, shape (a, n).
        """
        snapped = self.space.snap_all(z)
        out = np.flatnonzero(~self.allows(snapped))
        if len(out):
            nearest = anchors[np.argmin(cdist(snapped[out], anchors, "sqeuclidean"), axis=1)]
            edge = self._toward(nearest, snapped[out])
            # Points at the edge are not rounded, since rounding could leave the region.
            snapped[out] = self.space.snap_all(edge, only_integers=True)
        return snapped

    def _toward(
        self, start: Float[np.ndarray, "m n"], end: Float[np.ndarray, "m n"]
    ) -> Float[np.ndarray, "m n"]:
        """Return the last allowed point on each line from `start`, which is allowed, to `end`."""
        allowed, refused = np.zeros((len(start), 1)), np.ones((len(start), 1))
        allowed[self.allows(end)] = 1.0
        for _ in range(_HALVINGS):
            middle = (allowed + refused) / 2
            good = self.allows(start + middle * (end - start))[:, None]
            allowed, refused = np.where(good, middle, allowed), np.where(good, refused, middle)
        return np.asarray(start + allowed * (end - start))


def random_points(space: KnobSpace, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count n"]:
    """Return random points of the searched space that the constraints allow, shape (count, n).

    Raises:
        KnobError: If no allowed point was found.
    """
    if space.constraints:
        return Region(space).draw(count, rng)
    return space.scaled(rng.random((count, len(space))))
