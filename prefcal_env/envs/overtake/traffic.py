"""The other vehicles: the paper's obstacle, and drivers of highway-env."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from .geometry import Times
from .rules import OBSTACLE_SPEED, OBSTACLE_START

Places = Float[np.ndarray, "K 4"]
"""Rows of x, y [m], heading [rad] and speed along the road [m/s]; the first three are the pose."""


class Mover(Protocol):
    """The motion of another vehicle."""

    def at(self, t: Times) -> Places:
        """Return pose and speed at the times `t` [s], shape (K, 4)."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A vehicle that drives straight ahead and ignores all others; the defaults are the paper's."""

    x: float = OBSTACLE_START[0]  # initial front end [m]
    y: float = OBSTACLE_START[1]  # center line, to the left [m]
    speed: float = OBSTACLE_SPEED  # speed [m/s]

    def at(self, t: Times) -> Places:
        """Return pose and speed at the times `t` [s], shape (K, 4)."""
        places = np.empty((len(t), 4))
        places[:, 0] = self.x + self.speed * t
        places[:, 1:] = self.y, 0.0, self.speed
        return places


class Track:
    """The path that a driver of highway-env has driven so far, straight between two instants.

    This matches highway-env, which keeps speed and direction constant for a step.
    """

    def __init__(self) -> None:
        self._t: list[float] = []
        self._places: list[tuple[float, float, float, float]] = []

    def add(self, t: float, x: float, y: float, turned: float, speed: float) -> None:
        """Append pose and speed along the road [m/s] at `t` [s]."""
        self._t.append(t)
        self._places.append((x, y, turned, speed))

    def at(self, t: Times) -> Places:
        """Return pose and speed at the times `t` [s], shape (K, 4)."""
        known = np.array(self._places).T
        return np.stack([np.interp(t, self._t, values) for values in known], axis=1)
