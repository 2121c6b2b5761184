"""Many points of the unit cube at once, as the integers among the knobs let them run."""

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.knobs import KnobSpace


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


def scaled(space: KnobSpace, w: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """Points `w` of a unit cube, shape (m, n), as points of what is searched of `space`."""
    lower, upper = space.corners
    return np.asarray(lower + (upper - lower) * w)


def decode_all(space: KnobSpace, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """`KnobSpace.decode` of many points at once, up to rounding, shape (m, n)."""
    thetas = np.empty(z.shape)
    for k, knob in enumerate(space):
        low, high = (np.log10(v) if knob.scale == "log10" else v for v in (knob.low, knob.high))
        value = low * (1 - z[:, k]) + high * z[:, k]
        value = 10.0**value if knob.scale == "log10" else value
        value = np.floor(value + 0.5) if knob.integer else value
        thetas[:, k] = np.clip(value, knob.low, knob.high)
    return thetas
