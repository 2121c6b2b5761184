"""Drive one sampling period: where the bodies are, and what may end it early."""

from dataclasses import dataclass
from enum import Enum
from math import hypot

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.contact import Times, first_contact, travel
from prefcal_env.envs.overtake.road.geometry import REACH, Poses
from prefcal_env.envs.overtake.road.traffic import Mover, Obstacle
from prefcal_env.plants.plant import Plant

SUB_STEP = 0.02
"""Longest step between recorded instants [s]."""
ROAD_MARGIN = 1.0
"""Distance off the road at which a body has left it [m]."""
_SWERVE = 10.0
"""Bound on the extra distance of a vehicle in a period, beyond its initial speed, by accelerating
or moving sideways [m]."""
_NONE = np.zeros(0)


class Mishap(Enum):
    """Reason why an episode ended early."""

    COLLISION = "collision"
    OFF_ROAD = "off the road"
    NOT_FINITE = "not finite"


_MISHAPS = None, Mishap.NOT_FINITE, Mishap.OFF_ROAD
"""What the second number of `_kernels.kept` means."""


@dataclass(frozen=True, slots=True)
class Drive:
    """A driven period: its start and M instants after it; the last one is where it ended.

    Args:
        t: Instants [s], shape (M + 1,).
        x: States at `t`, shape (M + 1, n_x).
        mishap: Reason why it ended early; None if it did not.
    """

    t: Times
    x: Float[np.ndarray, "M1 n_x"]
    mishap: Mishap | None


def instants(T_s: float, periods: int) -> Float[np.ndarray, "periods M1"]:
    """Return the recorded instants of each period: its start, and the ends of M equal sub-steps.

    None is a sum of others, so time is exact.
    """
    n = max(1, int(np.ceil(T_s / SUB_STEP - 1e-9)))
    return np.asarray((np.arange(periods)[:, None] + np.arange(n + 1) / n) * T_s)


@dataclass(frozen=True, slots=True)
class Period:
    """One sampling period before it is driven, from state `x` with `u` held.

    `rows` are (x_o, y_o, v_o) of the other vehicles at its start, shape (n, 3); `road` is the
    right and the left edge of the road, y [m].
    """

    plant: Plant
    x: Float[np.ndarray, " n_x"]
    u: Float[np.ndarray, " 2"]
    movers: tuple[Mover, ...]
    rows: Float[np.ndarray, "n 3"]
    road: tuple[float, float]

    def drive(self, t: Times, others: Float[np.ndarray, "n M1 3"]) -> Drive:
        """Drive from the first of the instants `t` to the last, or to the first mishap.

        `others` are the poses of the other vehicles at `t`.
        """
        # Imported here so that importing the package does not load the compiler.
        from .road import _kernels

        after = self.plant.hold(self.x, self.u, _NONE, t[1:] - t[0])
        x = np.concatenate([self.x[None], after])
        kept, why = _kernels.kept(x, self.road, ROAD_MARGIN)
        mishap = _MISHAPS[why]
        t, x = t[: kept + 1], x[: kept + 1]
        touched = None if _kernels.surely_apart(x, others) else self._contact(t, x)
        if touched is not None:
            n = int(np.searchsorted(t[1:], touched)) + 1
            x = np.concatenate([x[:n], self._states(np.array([touched]), float(t[0]))])
            t, mishap = np.append(t[:n], touched), Mishap.COLLISION
        return Drive(t, x, mishap)

    def _contact(self, t: Times, x: Float[np.ndarray, "M1 n_x"]) -> float | None:
        """Return when the ego vehicle first touches one that comes near; None if it does not."""
        start = float(t[0])
        moved = float(travel(x[:, :3]).sum())
        own_x, own_y, *_ = self.x.tolist()
        near = []
        for mover, (x_o, y_o, v_o) in zip(self.movers, self.rows.tolist(), strict=True):
            straight = isinstance(mover, Obstacle) and mover.moves_to is None
            further = 0.0 if straight else _SWERVE
            reach = 2 * REACH + moved + further + abs(v_o) * (t[-1] - start)
            if hypot(x_o - own_x, y_o - own_y) <= reach:
                near.append(mover)
        if not near:
            return None

        def motion(at: Times) -> tuple[Poses, list[Poses]]:
            return self._states(at, start)[:, :3], [mover.poses(at) for mover in near]

        return first_contact(motion, t)

    def _states(self, t: Times, start: float) -> Float[np.ndarray, "K n_x"]:
        later = t[t > start]
        x = self.plant.hold(self.x, self.u, _NONE, later - start)
        return x if len(later) == len(t) else np.concatenate([self.x[None], x])
