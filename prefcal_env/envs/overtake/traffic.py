"""The other vehicles: straight ahead at constant speed, or braking from some time on."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.geometry import Poses
from prefcal_env.errors import SettingsError
from prefcal_env.overtaking import OBSTACLE_SPEED, OBSTACLE_START


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A vehicle that drives straight ahead; by default the paper's.

    Args:
        x: Front end at the start [m].
        y: Its centre line, to the left [m].
        speed: At the start [m/s].
        deceleration: From `brakes_at` on until it stands [m/s²].
        brakes_at: When it begins to brake [s].

    Raises:
        SettingsError: a number that is not finite; a speed, deceleration or time below 0.
    """

    x: float = OBSTACLE_START[0]
    y: float = OBSTACLE_START[1]
    speed: float = OBSTACLE_SPEED
    deceleration: float = 0.0
    brakes_at: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            low = -np.inf if field.name in ("x", "y") else 0.0
            if not (np.isfinite(value) and value >= low):
                raise SettingsError(
                    f"obstacle: {field.name} must be finite"
                    + ("" if low else " and at least 0")
                    + f", got {value}"
                )

    def speeds(self, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
        """Its speed at the times `t` [s], m/s, shape (K,)."""
        return self.speed - self.deceleration * self._braking(t)

    def poses(self, t: Float[np.ndarray, " K"]) -> Poses:
        """Its poses at the times `t` [s], shape (K, 3)."""
        braking = self._braking(t)
        # Braking ends where it stands: what it did not drive after that is not subtracted twice.
        lost = self.deceleration * braking * (np.maximum(t - self.brakes_at, 0) - braking / 2)
        x = self.x + self.speed * t - lost
        return np.stack([x, np.full_like(x, self.y), np.zeros_like(x)], axis=1)

    def _braking(self, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
        """For how long it has been braking until `t` or until it stood [s], shape (K,)."""
        if self.deceleration == 0:
            return np.zeros_like(t)
        return np.clip(t - self.brakes_at, 0.0, self.speed / self.deceleration)


def rows(obstacles: tuple[Obstacle, ...], t: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n 3"]:
    """(x_o, y_o [m], v_o [m/s]) of each at the times `t` [s], shape (K, n, 3)."""
    each = [np.column_stack([o.poses(t)[:, :2], o.speeds(t)]) for o in obstacles]
    return np.stack(each, axis=1)
