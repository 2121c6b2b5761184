"""Drive one sampling period: where the bodies are, and what may end it early."""

from dataclasses import dataclass
from enum import Enum
from math import hypot

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.contact import Times, first_contact, travel
from prefcal_env.envs.overtake.road.geometry import REACH, Poses, outside
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


@dataclass(frozen=True, slots=True)
class Drive:
    """A driven period: M instants after its start; the last one is where it ended.

    Args:
        t: Instants [s], shape (M,).
        x: States at `t`, shape (M, n_x).
        mishap: Reason why it ended early; None if it did not.
    """

    t: Times
    x: Float[np.ndarray, "M n_x"]
    mishap: Mishap | None


def sub_steps(T_s: float) -> Times:
    """Return the shares of a period at which it is recorded: n sub-steps of T_s/n; the last is 1.

    The instants of step k are (k + shares) T_s: none is a sum of others, so time is exact.
    """
    n = max(1, int(np.ceil(T_s / SUB_STEP - 1e-9)))
    return np.arange(1, n + 1) / n


@dataclass(frozen=True, slots=True)
class Period:
    """One sampling period before it is driven: from state `x` at time `start` [s], with `u` held.

    `rows` are (x_o, y_o, v_o) of the other vehicles at its start, shape (n, 3); `road` is the
    right and the left edge of the road, y [m].
    """

    plant: Plant
    x: Float[np.ndarray, " n_x"]
    u: Float[np.ndarray, " 2"]
    start: float
    movers: tuple[Mover, ...]
    rows: Float[np.ndarray, "n 3"]
    road: tuple[float, float]

    def drive(self, t: Times) -> Drive:
        """Drive to the instants `t`, or to the first mishap."""
        x = self.plant.hold(self.x, self.u, _NONE, t - self.start)
        mishap: Mishap | None = None
        finite = np.isfinite(x).all(axis=1)
        if not finite.all():
            n = int(np.argmin(finite))
            t, x, mishap = t[:n], x[:n], Mishap.NOT_FINITE
        left = np.flatnonzero(outside(x[:, :3], self.road) > ROAD_MARGIN)
        if len(left):
            n = int(left[0]) + 1
            t, x, mishap = t[:n], x[:n], Mishap.OFF_ROAD
        touched = self._contact(t, x) if len(t) else None
        if touched is not None:
            n = int(np.searchsorted(t, touched))
            t = np.append(t[:n], touched)
            x = np.concatenate([x[:n], self._states(np.array([touched]))])
            mishap = Mishap.COLLISION
        return Drive(t, x, mishap)

    def _contact(self, t: Times, x: Float[np.ndarray, "M n_x"]) -> float | None:
        """Return when the ego vehicle first touches one that comes near; None if it does not."""
        times = np.append(self.start, t)
        moved = float(travel(np.concatenate([self.x[None, :3], x[:, :3]])).sum())
        own_x, own_y, *_ = self.x.tolist()
        near = []
        for mover, (x_o, y_o, v_o) in zip(self.movers, self.rows.tolist(), strict=True):
            straight = isinstance(mover, Obstacle) and mover.moves_to is None
            further = 0.0 if straight else _SWERVE
            reach = 2 * REACH + moved + further + abs(v_o) * (times[-1] - self.start)
            if hypot(x_o - own_x, y_o - own_y) <= reach:
                near.append(mover)
        if not near:
            return None
        return first_contact(lambda at: (self._poses(at), [o.poses(at) for o in near]), times)

    def _poses(self, t: Times) -> Poses:
        return self._states(t)[:, :3]

    def _states(self, t: Times) -> Float[np.ndarray, "K n_x"]:
        later = t[t > self.start]
        x = self.plant.hold(self.x, self.u, _NONE, later - self.start)
        return x if len(later) == len(t) else np.concatenate([self.x[None], x])
