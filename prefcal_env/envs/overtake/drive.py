"""Drive one sampling period: where the bodies are, and what may end it early."""

from dataclasses import dataclass
from enum import Enum
from math import hypot

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.contact import BENT, Times, first_contact, travel
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


def instants(T_s: float, periods: int) -> Float[np.ndarray, "periods M1"]:
    """Return the recorded instants of each period: its start, and the ends of M equal sub-steps.

    None is a sum of others, so time is exact.
    """
    n = max(1, int(np.ceil(T_s / SUB_STEP - 1e-9)))
    return np.asarray((np.arange(periods)[:, None] + np.arange(n + 1) / n) * T_s)


@dataclass(frozen=True, slots=True)
class Scene:
    """What an episode drives through, one sampling period after another.

    Args:
        plant: Plant that moves the ego vehicle.
        movers: The other vehicles.
        road: Right and left edge of the road, y [m].
    """

    plant: Plant
    movers: tuple[Mover, ...]
    road: tuple[float, float]

    def drive(
        self,
        x: Float[np.ndarray, " n_x"],
        u: Float[np.ndarray, " 2"],
        t: Times,
        others: Float[np.ndarray, "n M1 3"],
    ) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, "D n_x"], Mishap | None]:
        """Drive from state `x` with `u` held, from the first of `t` to the last or to a mishap.

        `others` are the poses of the other vehicles at `t`.

        Returns:
            The instants, shape (D,), up to the one where the period ended, the states at them, and
            the reason why it ended early; None if it did not.
        """
        # Imported here so that importing the package does not load the compiler.
        from .road import _kernels

        states = np.concatenate([x[None], self.plant.hold(x, u, _NONE, t[1:] - t[0])])
        kept, why = _kernels.kept(states, self.road, ROAD_MARGIN)
        mishap = _MISHAPS[why]
        t, states = t[: kept + 1], states[: kept + 1]
        touched = None
        if not _kernels.surely_apart(states, others, BENT, REACH):
            touched = self._contact(u, t, states, others)
        if touched is not None:
            n = int(np.searchsorted(t[1:], touched)) + 1
            at_contact = self._states(x, u, float(t[0]), np.array([touched]))
            states = np.concatenate([states[:n], at_contact])
            t, mishap = np.append(t[:n], touched), Mishap.COLLISION
        return t, states, mishap

    def _contact(
        self,
        u: Float[np.ndarray, " 2"],
        t: Times,
        states: Float[np.ndarray, "K n_x"],
        others: Float[np.ndarray, "n M1 3"],
    ) -> float | None:
        """Return when the ego vehicle first touches one that comes near; None if it does not."""
        x, start = states[0], float(t[0])
        moved = float(travel(states[:, :3]).sum())
        own_x, own_y, *_ = x.tolist()
        near = []
        for mover, (x_o, y_o, _) in zip(self.movers, others[:, 0].tolist(), strict=True):
            straight = isinstance(mover, Obstacle) and mover.moves_to is None
            further = 0.0 if straight else _SWERVE
            v_o = float(mover.speeds(t[:1])[0])
            reach = 2 * REACH + moved + further + abs(v_o) * (t[-1] - start)
            if hypot(x_o - own_x, y_o - own_y) <= reach:
                near.append(mover)
        if not near:
            return None

        def motion(at: Times) -> tuple[Poses, list[Poses]]:
            return self._states(x, u, start, at)[:, :3], [mover.poses(at) for mover in near]

        return first_contact(motion, t)

    def _states(
        self, x: Float[np.ndarray, " n_x"], u: Float[np.ndarray, " 2"], start: float, t: Times
    ) -> Float[np.ndarray, "K n_x"]:
        """Return the states at `t` [s], from `x` at `start` with `u` held."""
        later = t[t > start]
        after = self.plant.hold(x, u, _NONE, later - start)
        return after if len(later) == len(t) else np.concatenate([x[None], after])
