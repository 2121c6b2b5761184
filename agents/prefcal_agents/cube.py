"""The unit cube as an agent sees it: many points at once, and points not tried before."""

from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.errors import KnobError, ProtocolError
from prefcal_env.knobs import KnobSpace

from .ledger import Ledger
from .minimise import Domain
from .turns import capacity

_DRAWS = 200  # random points looked at before an integer space is searched in full


def integer_mask(space: KnobSpace) -> Bool[np.ndarray, " n"]:
    """Which knobs are integers, shape (n,)."""
    return np.array([knob.integer for knob in space], dtype=np.bool_)


def snap_all(space: KnobSpace, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """`KnobSpace.snap` of the integer coordinates of many points at once, shape (m, n).

    Points outside of what is searched are moved to its border.
    """
    snapped = np.asarray(np.clip(z, *space.corners))
    for k, knob in enumerate(space):
        if not knob.integer:
            continue
        if knob.scale == "log10":
            low, decades = np.log10(knob.low), np.log10(knob.high / knob.low)
            value = np.floor(10.0 ** (low + decades * snapped[:, k]) + 0.5)
            snapped[:, k] = np.log10(np.clip(value, knob.low, knob.high) / knob.low) / decades
        else:
            width = knob.high - knob.low
            value = np.floor(knob.low + width * snapped[:, k] + 0.5)
            snapped[:, k] = (np.clip(value, knob.low, knob.high) - knob.low) / width
    return snapped


def encode_all(space: KnobSpace, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """Points of the cube of many physical θ, shape (m, n).

    Raises:
        KnobError: `thetas` has another shape or leaves the box.
    """
    if np.ndim(thetas) != 2:
        raise KnobError(f"thetas must have shape (m, {len(space)}), got {np.shape(thetas)}")
    return np.array([space.encode(theta) for theta in thetas]).reshape(-1, len(space))


def latin_hypercube(space: KnobSpace, count: int, seed: int) -> Float[np.ndarray, "N n"]:
    """`count` space-filling points of the cube, shape (count, n).

    Source: section IV of the paper: the start of GLISp.
    """
    from scipy.stats import qmc  # takes most of a second to import

    sampler = qmc.LatinHypercube(len(space), rng=np.random.default_rng([seed, 0]))
    return scaled(space, np.asarray(sampler.random(count), dtype=float))


def scaled(space: KnobSpace, w: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """Points `w` of a unit cube, shape (m, n), as points of what is searched of `space`."""
    lower, upper = space.corners
    return np.asarray(lower + (upper - lower) * w)


def search_box(space: KnobSpace, start: Float[np.ndarray, " n"]) -> Domain:
    """What is searched of `space`, for a minimiser; frozen knobs stay put."""
    lower, upper = space.corners
    fixed = integer_mask(space) | (lower == upper)
    return Domain(fixed, lambda z: snap_all(space, z), np.clip(start, lower, upper), lower, upper)


class Tried:
    """The θ that ran: no θ runs twice, and several points of the cube may decode to one."""

    def __init__(self, space: KnobSpace, ledger: Ledger) -> None:
        self._space = space
        self._seen = {self._key(np.array(z)) for z in ledger.samples[: ledger.answered]}

    def _key(self, z: Float[np.ndarray, " n"]) -> bytes:
        # Adding 0.0 turns -0.0 into 0.0, which is the same θ.
        return (self._space.decode(z) + 0.0).tobytes()

    def __contains__(self, z: Float[np.ndarray, " n"]) -> bool:
        return self._key(self._space.snap(z)) in self._seen

    def fresh(
        self, z: Float[np.ndarray, " n"], rng: np.random.Generator
    ) -> Float[np.ndarray, " n"]:
        """`z`, shape (n,), or if its θ ran already, another point whose θ did not.

        Random points are those of what is searched.

        Raises:
            ProtocolError: every θ of the space has been tried.
        """
        if z not in self:
            return z
        for candidate in scaled(self._space, rng.random((_DRAWS, len(z)))):
            if candidate not in self:
                return np.asarray(candidate)
        if not np.isfinite(capacity(self._space)):
            raise ProtocolError(f"no new θ was found in {_DRAWS} random draws")
        return self._first_free()

    def _first_free(self) -> Float[np.ndarray, " n"]:
        # Few θ are left, so the space is small: at most some times the number of samples.
        values = [
            [low] if low == high else range(int(low), int(high) + 1)
            for low, high in self._space.within
        ]
        for theta in product(*values):
            z = self._space.encode(np.array(theta, dtype=float))
            if z not in self:
                return z
        raise ProtocolError(f"every one of the {len(self._seen)} θ of the space has been tried")
