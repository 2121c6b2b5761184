"""The other vehicles: the paper's obstacle, and drivers of highway-env."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from .geometry import Poses
from .rules import OBSTACLE_SPEED, OBSTACLE_START

Times = Float[np.ndarray, " K"]


class Mover(Protocol):
    """The motion of another vehicle."""

    def poses(self, t: Times) -> Poses:
        """Return the poses at the times `t` [s], shape (K, 3)."""

    def speeds(self, t: Times) -> Times:
        """Return the speed along the road at the times `t` [s], m/s, shape (K,)."""

    def row(self, t: float) -> tuple[float, float, float]:
        """Return (x_o, y_o [m], v_o [m/s]) at the time `t` [s]."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A vehicle that drives straight ahead and ignores all others; the defaults are the paper's.

    Args:
        x: Initial front end [m].
        y: Center line, to the left [m].
        speed: Speed [m/s].
    """

    x: float = OBSTACLE_START[0]
    y: float = OBSTACLE_START[1]
    speed: float = OBSTACLE_SPEED

    def speeds(self, t: Times) -> Times:
        """Return the speed along the road at `t` [s], m/s, shape (K,)."""
        return np.full_like(t, self.speed)

    def poses(self, t: Times) -> Poses:
        """Return the poses at the times `t` [s], shape (K, 3)."""
        x = self.x + self.speed * t
        return np.stack([x, np.full_like(x, self.y), np.zeros_like(x)], axis=1)

    def row(self, t: float) -> tuple[float, float, float]:
        """Return (x_o, y_o [m], v_o [m/s]) at the time `t` [s]."""
        return self.x + self.speed * t, self.y, self.speed


class Track:
    """The path that a driver of highway-env has driven so far, straight between two instants.

    This matches highway-env, which keeps speed and direction constant for a step.
    """

    def __init__(self) -> None:
        self._t: list[float] = []
        self._rows: list[tuple[float, float, float, float]] = []

    def add(self, t: float, x: float, y: float, turned: float, speed: float) -> None:
        """Append pose and speed along the road [m/s] at `t` [s]."""
        self._t.append(t)
        self._rows.append((x, y, turned, speed))

    def poses(self, t: Times) -> Poses:
        """Return the poses at the times `t` [s], shape (K, 3)."""
        return np.stack([self._at(t, i) for i in range(3)], axis=1)

    def speeds(self, t: Times) -> Times:
        """Return the speed along the road at the times `t` [s], m/s, shape (K,)."""
        return self._at(t, 3)

    def row(self, t: float) -> tuple[float, float, float]:
        """Return (x_o, y_o [m], v_o [m/s]) at the time `t` [s]."""
        x, y, speed = (float(self._at(np.array([t]), i)[0]) for i in (0, 1, 3))
        return x, y, speed

    def _at(self, t: Times, column: int) -> Times:
        return np.asarray(np.interp(t, self._t, [row[column] for row in self._rows]))
