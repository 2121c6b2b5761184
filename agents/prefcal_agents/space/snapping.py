"""Round many points of the unit cube at once to values that each knob can be set to."""

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.knobs.knob import Knob, KnobSpace


def integer_mask(space: KnobSpace) -> Bool[np.ndarray, " n"]:
    """Return which knobs are integers, shape (n,)."""
    return np.array([knob.integer for knob in space], dtype=np.bool_)


def snap_all(
    space: KnobSpace, z: Float[np.ndarray, "m n"], *, only_integers: bool = False
) -> Float[np.ndarray, "m n"]:
    """Round many points at once like `KnobSpace.snap` without constraints, shape (m, n).

    Points outside the searched range move to its border.
    """
    lower, upper = space.corners
    snapped = np.asarray(np.clip(z, lower, upper))
    for k, knob in enumerate(space):
        if knob.resolution == 0 or (only_integers and not knob.integer):
            continue
        column = _encoded(knob, _rounded(knob, _decoded(knob, snapped[:, k])))
        snapped[:, k] = np.clip(column, lower[k], upper[k])
    return snapped


def scaled(space: KnobSpace, w: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """Return points `w` of a unit cube, shape (m, n), scaled to the searched part of `space`."""
    lower, upper = space.corners
    return np.asarray(lower + (upper - lower) * w)


def decode_all(space: KnobSpace, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """Decode many points at once like `KnobSpace.decode`, up to rounding, shape (m, n)."""
    thetas = np.empty(z.shape)
    for k, knob in enumerate(space):
        value = _decoded(knob, z[:, k])
        value = np.floor(value + 0.5) if knob.integer else value
        thetas[:, k] = np.clip(value, knob.low, knob.high)
    return thetas


def _decoded(knob: Knob, z: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    low, high = (np.log10(v) if knob.scale == "log10" else v for v in (knob.low, knob.high))
    value = low * (1 - z) + high * z
    return np.asarray(10.0**value if knob.scale == "log10" else value)


def _encoded(knob: Knob, value: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    if knob.scale == "log10":
        return np.asarray(np.log10(value / knob.low) / np.log10(knob.high / knob.low))
    return np.asarray((value - knob.low) / (knob.high - knob.low))


def _rounded(knob: Knob, value: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Round like `Knob.round`, but without cutting powers of the step to a few digits."""
    step = knob.resolution
    if knob.scale == "log10" and not knob.integer:
        count = np.floor(np.log(value / knob.low) / np.log1p(step) + 0.5)
        near = knob.low * (1 + step) ** count
    else:
        near = np.floor(value / step + 0.5) * step
    near = np.clip(near, knob.low, knob.high)
    for end in (knob.low, knob.high):
        near = np.where(np.abs(end - value) < np.abs(near - value), end, near)
    return np.asarray(near)
