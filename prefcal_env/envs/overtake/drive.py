"""Drive one sampling period: where the bodies are, and what may end it early."""

from collections.abc import Sequence
from enum import Enum

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.contact import BENT, Times, first_contact
from prefcal_env.envs.overtake.road.geometry import REACH, Poses
from prefcal_env.envs.overtake.road.traffic import Mover
from prefcal_env.plants.bicycle import Bicycle

SUB_STEP = 0.02
"""Longest step between recorded instants [s]."""
ROAD_MARGIN = 1.0
"""Distance off the road at which a body has left it [m]."""
_PLANT, _NONE = Bicycle(), np.zeros(0)


class Mishap(Enum):
    """Reason why an episode ended early."""

    COLLISION = "collision"
    OFF_ROAD = "off the road"
    NOT_FINITE = "not finite"


_MISHAPS = None, Mishap.NOT_FINITE, Mishap.OFF_ROAD
"""What the second number of `_kernels.kept` means."""


def instants(T_s: float, periods: int) -> Float[np.ndarray, "periods M1"]:
    """Return the recorded instants of each period: its start, and the ends of M equal sub-steps.

    None is a sum of others, so time is exact.
    """
    n = max(1, int(np.ceil(T_s / SUB_STEP - 1e-9)))
    return np.asarray((np.arange(periods)[:, None] + np.arange(n + 1) / n) * T_s)


def drive(
    x: Float[np.ndarray, " 3"],
    u: Float[np.ndarray, " 2"],
    t: Times,
    movers: Sequence[Mover],
    others: Float[np.ndarray, "n M1 3"],
    road: tuple[float, float],
) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, "D 3"], Mishap | None]:
    """Drive from state `x` with `u` held, from the first of `t` to the last or to a mishap.

    `others` are the poses of the `movers` at `t`, `road` are the right and left edge of the road.

    Returns:
        The instants, shape (D,), up to the one where the period ended, the states at them, and
        the reason why it ended early; None if it did not.
    """
    # Imported here so that importing the package does not load the compiler.
    from .road import _kernels

    def motion(at: Times) -> tuple[Poses, list[Poses]]:
        return _states(x, u, float(t[0]), at), [mover.poses(at) for mover in movers]

    states = np.concatenate([x[None], _PLANT.hold(x, u, _NONE, t[1:] - t[0])])
    kept, why = _kernels.kept(states, road, ROAD_MARGIN)
    mishap, touched = _MISHAPS[why], None
    kept_t, states = t[: kept + 1], states[: kept + 1]
    if not _kernels.surely_apart(states, others, BENT, REACH):
        touched = first_contact(motion, kept_t)
    if touched is not None:
        n = int(np.searchsorted(kept_t[1:], touched)) + 1
        states = np.concatenate([states[:n], _states(x, u, float(t[0]), np.array([touched]))])
        kept_t, mishap = np.append(kept_t[:n], touched), Mishap.COLLISION
    return kept_t, states, mishap


def _states(
    x: Float[np.ndarray, " 3"], u: Float[np.ndarray, " 2"], start: float, t: Times
) -> Float[np.ndarray, "K 3"]:
    """Return the states at `t` [s], from `x` at `start` with `u` held."""
    later = t[t > start]
    after = _PLANT.hold(x, u, _NONE, later - start)
    return after if len(later) == len(t) else np.concatenate([x[None], after])
