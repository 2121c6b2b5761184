"""Find the first contact of moving bodies, including contacts between the given instants."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .geometry import REACH, Poses, separation

CONTACT = 1e-3
"""Distance below which bodies have touched [m]."""
BENT = 1.1
"""Factor by which a path between two close instants may be longer than its chord."""

Times = Float[np.ndarray, " K"]
Motion = Callable[[Times], tuple[Poses, list[Poses]]]
"""Maps instants, shape (K,), to the poses of the ego body and of each other body, (K, 3)."""


def first_contact(motion: Motion, times: Times) -> float | None:
    """Return when the ego body first touches another within `times`; None if it does not.

    Bodies can touch between two instants only if together they move by more than their distance
    (see `separation`) at both. If so, the instants in the middle are checked too, until a contact
    is ruled out or the motion is below `CONTACT`. So no contact is missed, and the returned time
    is that of the first one up to a motion of `CONTACT`.

    Args:
        motion: Function that returns the poses at any instants within `times`.
        times: Increasing instants, shape (K,), K >= 2, so close that no body turns by 1 rad in
            between.
    """
    while True:
        own, others = motion(times)
        apart = np.min([separation(own, other) for other in others], axis=0)
        if apart[0] <= 0:
            return float(times[0])
        touching = np.flatnonzero(apart <= 0)
        n = int(touching[0]) + 1 if len(touching) else len(times)  # ignore what happens later
        moved = travel(own) + np.max([travel(other) for other in others], axis=0)
        may_touch = (apart[:-1] + apart[1:] <= moved) | (apart[1:] <= 0)
        possible = np.flatnonzero(may_touch[: n - 1])
        if not len(possible):
            return None
        if moved[possible[0]] < CONTACT:
            return float(times[possible[0] + 1])
        # From the first interval with a possible contact to the last one.
        first, last = possible[0], possible[-1] + 2
        middles = (times[possible] + times[possible + 1]) / 2
        times = np.sort(np.concatenate([times[first:last], middles]))


def travel(poses: Poses) -> Float[np.ndarray, " K-1"]:
    """Return a lower bound on the motion of any point of a body between instants [m]."""
    step = np.diff(poses, axis=0)
    return np.asarray(BENT * (np.hypot(step[:, 0], step[:, 1]) + REACH * np.abs(step[:, 2])))
