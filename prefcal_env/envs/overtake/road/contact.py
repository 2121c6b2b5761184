"""The first contact of moving bodies, also between the instants that one has looked at."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .geometry import REACH, Poses, separation

CONTACT = 1e-3
"""Bodies that come closer than this have touched [m]."""
_BENT = 1.1
"""A path between two close instants is at most this much longer than its chord."""

Times = Float[np.ndarray, " K"]
Motion = Callable[[Times], tuple[Poses, list[Poses]]]
"""Instants, shape (K,), to the poses of the own body and of each other one, each (K, 3)."""


def first_contact(motion: Motion, times: Times) -> float | None:
    """When the own body first touches another within `times`, None if it does not.

    Bodies can only touch between two instants if they move by more than they are apart (see
    `separation`) at both together. Where that is so, the instants in the middle are looked at
    too, until it is excluded or the motion is below `CONTACT`. So no contact is missed, and the
    time is that of the first one to within a motion of `CONTACT`.

    Args:
        motion: The poses at any instants within `times`.
        times: Increasing, shape (K,), K >= 2, so close that no body turns by 1 rad in between.
    """
    while True:
        own, others = motion(times)
        apart = np.min([separation(own, other) for other in others], axis=0)
        if apart[0] <= 0:
            return float(times[0])
        touching = np.flatnonzero(apart <= 0)
        n = int(touching[0]) + 1 if len(touching) else len(times)  # what is later is too late
        moved = travel(own) + np.max([travel(other) for other in others], axis=0)
        may_touch = (apart[:-1] + apart[1:] <= moved) | (apart[1:] <= 0)
        possible = np.flatnonzero(may_touch[: n - 1])
        if not len(possible):
            return None
        if moved[possible[0]] < CONTACT:
            return float(times[possible[0] + 1])
        # From the first place where they may touch to the last one.
        first, last = possible[0], possible[-1] + 2
        middles = (times[possible] + times[possible + 1]) / 2
        times = np.sort(np.concatenate([times[first:last], middles]))


def travel(poses: Poses) -> Float[np.ndarray, " K-1"]:
    """At least how far any point of a body moves from each instant to the next [m]."""
    step = np.diff(poses, axis=0)
    return np.asarray(_BENT * (np.hypot(step[:, 0], step[:, 1]) + REACH * np.abs(step[:, 2])))
