"""The part of the unit cube that the constraints allow: random points of it, and ways into it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from prefcal_agents.history.history import History
from prefcal_agents.models.rbf import squared_distances
from prefcal_agents.optimize.search import Domain
from prefcal_env.errors import KnobError
from prefcal_env.knobs.knob import KnobSpace

from .snapping import decode_all, integer_mask, scaled, snap_all

_BLOCKS = (300, 1_000, 4_000, 16_000)  # random points looked at, a block at a time
_LEADERS = 20  # points from which an allowed one is searched where no random one is
_AROUND = 30  # points tried around each of them, at each of these
_STEPS = np.geomspace(0.3, 1e-5, 40)  # in units of the cube
_HALVINGS = 14  # of the way to an allowed point
_ROUNDS = 3  # of drawing on from points drawn before


@dataclass(frozen=True, slots=True)
class Region:
    """What the constraints of `space` allow, as points of the cube that are snapped as they run."""

    space: KnobSpace

    def allows(self, z: Float[np.ndarray, "m n"]) -> Bool[np.ndarray, " m"]:
        """Whether the θ of each row of `z` is allowed, shape (m,)."""
        return np.asarray(self.space.allows(self._thetas(z)))

    def _thetas(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        return decode_all(self.space, snap_all(self.space, z, only_integers=True))

    def draw(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count n"]:
        """Random points of the region, shape (count, n); uniform unless it is tiny.

        Raises:
            KnobError: none was found.
        """
        n = len(self.space)
        found = np.zeros((0, n))
        for size in _BLOCKS:
            block = scaled(self.space, rng.random((max(size, count), n)))
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
        """Hit and run: from a random anchor a random part of the way to the edge, (count, n)."""
        start = anchors[rng.integers(len(anchors), size=count)]
        edge = self._towards(start, scaled(self.space, rng.random((count, start.shape[1]))))
        inside = start + rng.random((count, 1)) * (edge - start)
        return np.where(self.allows(inside)[:, None], inside, start)

    def _search(self, rng: np.random.Generator) -> Float[np.ndarray, "a n"]:
        """Allowed points, by going where the constraints are violated less and less."""
        leaders = scaled(self.space, rng.random((_BLOCKS[-1], len(self.space))))
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
            f"less, but where they are closest to it, {self.space.named(theta[0])}, {violated}"
        )

    def repaired(
        self, z: Float[np.ndarray, "m n"], anchors: Float[np.ndarray, "a n"]
    ) -> Float[np.ndarray, "m n"]:
        """The rows of `z` snapped; from the nearest anchor up to the edge where not allowed.

        The anchors are allowed points, shape (a, n).
        """
        snapped = snap_all(self.space, z)
        out = np.flatnonzero(~self.allows(snapped))
        if len(out):
            nearest = anchors[np.argmin(squared_distances(snapped[out], anchors), axis=1)]
            edge = self._towards(nearest, snapped[out])
            # A rounded point beyond the edge is refused: those at the edge are not rounded.
            snapped[out] = snap_all(self.space, edge, only_integers=True)
        return snapped

    def _towards(
        self, start: Float[np.ndarray, "m n"], end: Float[np.ndarray, "m n"]
    ) -> Float[np.ndarray, "m n"]:
        """An allowed point of each way from `start`, which is allowed, to `end`; at its edge."""
        allowed, refused = np.zeros((len(start), 1)), np.ones((len(start), 1))
        allowed[self.allows(end)] = 1.0
        for _ in range(_HALVINGS):
            middle = (allowed + refused) / 2
            good = self.allows(start + middle * (end - start))[:, None]
            allowed, refused = np.where(good, middle, allowed), np.where(good, refused, middle)
        return np.asarray(start + allowed * (end - start))


def random_points(
    space: KnobSpace, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "count n"]:
    """Random points of the cube, or of what the constraints leave of it, shape (count, n).

    Raises:
        KnobError: none was found that they allow.
    """
    if space.constraints:
        return Region(space).draw(count, rng)
    return scaled(space, rng.random((count, len(space))))


def search_domain(space: KnobSpace, history: History, *, best: int | None = None) -> Domain:
    """Where an acquisition is minimised: the cube, or what the constraints leave of it.

    Of a space that is searched in part it is that part; frozen knobs stay put.

    Points that are not allowed are moved to the edge of the region; so a search need not know
    about it, and finds optima at the edge. It starts at sample number `best`, or the incumbent.
    """
    lower, upper = space.corners
    best = (history.incumbent or 0) if best is None else best
    start = np.clip(np.array(history.samples[best]), lower, upper)
    fixed = integer_mask(space) | (lower == upper)
    if not space.constraints:
        return Domain(fixed, lambda z: snap_all(space, z), start, (lower, upper))
    region, anchors = Region(space), _anchors(space, history)
    return Domain(fixed, lambda z: region.repaired(z, anchors), start, (lower, upper))


def _anchors(space: KnobSpace, history: History) -> Float[np.ndarray, "a n"]:
    """Allowed points of what is searched: the samples there, or random ones if there are none."""
    tried = history.cube()
    lower, upper = space.corners
    inside = tried[np.all((tried >= lower) & (tried <= upper), axis=1)]
    if len(inside):
        return np.asarray(inside)
    return random_points(space, _LEADERS, np.random.default_rng(history.answered))
