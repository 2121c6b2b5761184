"""The other vehicles: obstacles on a fixed course, or drivers who keep their distance."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import pi
from typing import Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError

from .geometry import Poses
from .rules import LENGTH, OBSTACLE_SPEED, OBSTACLE_START

Times = Float[np.ndarray, " K"]
_LOWEST = {"x": -np.inf, "y": -np.inf, "moves_to": -np.inf, "moves_within": 0.5}


class Mover(Protocol):
    """The motion of another vehicle.

    A pose is that of the end that is farther along the road, on the center line, with the angle
    of the body from the road's direction: the front end, or the rear end of an oncoming vehicle.
    """

    def poses(self, t: Times) -> Poses:
        """Return the poses at the times `t` [s], shape (K, 3)."""

    def speeds(self, t: Times) -> Times:
        """Return the speed along the road at the times `t` [s], m/s, shape (K,)."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A vehicle on a fixed course that ignores all others; the defaults are the paper's.

    It drives straight ahead, and may brake, move to another line, or come toward us.

    Args:
        x: Initial front end [m].
        y: Initial center line, to the left [m].
        speed: Initial speed [m/s].
        deceleration: Deceleration from `brakes_at` until it stands still [m/s²].
        brakes_at: Time at which it begins to brake [s].
        moves_to: Center line that it moves to, y [m]; None keeps its line.
        moves_at: Time at which it begins to move sideways [s].
        moves_within: Duration of the move [s], at least 0.5.
        oncoming: Whether it drives against the road's direction.

    Raises:
        SettingsError: If a number is not finite, or a speed, deceleration or time is below 0.
    """

    x: float = OBSTACLE_START[0]
    y: float = OBSTACLE_START[1]
    speed: float = OBSTACLE_SPEED
    deceleration: float = 0.0
    brakes_at: float = 0.0
    moves_to: float | None = None
    moves_at: float = 0.0
    moves_within: float = 3.0
    oncoming: bool = False

    def __post_init__(self) -> None:
        _check(self, {"moves_to": None})

    def speeds(self, t: Times) -> Times:
        """Return the speed along the road at `t` [s], m/s, shape (K,); negative if oncoming."""
        speed = self.speed - self.deceleration * self._braking(t)
        return -speed if self.oncoming else speed

    def poses(self, t: Times) -> Poses:
        """Return the poses at the times `t` [s], shape (K, 3), as in `Mover`."""
        braking = self._braking(t)
        # Braking ends when it stands still; after that, no more distance may be subtracted.
        lost = self.deceleration * braking * (np.maximum(t - self.brakes_at, 0) - braking / 2)
        x = self.x + self.speed * t - lost
        if self.oncoming:
            x = 2 * self.x + LENGTH - x
        if self.moves_to is None:
            return np.stack([x, np.full_like(x, self.y), np.zeros_like(x)], axis=1)
        share = np.clip((t - self.moves_at) / self.moves_within, 0.0, 1.0)
        aside = self.moves_to - self.y
        y = self.y + aside * share**3 * (10 - 15 * share + 6 * share**2)
        rate = aside * 30 * share**2 * (1 - share) ** 2 / self.moves_within  # m/s
        forward = np.maximum(np.abs(self.speeds(t)), 1.0)
        turned = np.arctan2(-rate if self.oncoming else rate, forward)
        return np.stack([x, y, turned], axis=1)

    def _braking(self, t: Times) -> Times:
        """Return how long it has been braking at `t`, or until it stood still [s], shape (K,)."""
        if self.deceleration == 0:
            return np.zeros_like(t)
        return np.clip(t - self.brakes_at, 0.0, self.speed / self.deceleration)


@dataclass(frozen=True, slots=True)
class Driver:
    """A vehicle of highway-env that reacts to others: it keeps its distance and may change lanes.

    The intelligent driver model (IDM) decides the speed, MOBIL the lane.

    Args:
        x: Initial front end [m].
        y: Initial center line, to the left [m].
        speed: Initial speed [m/s], above 0.
        target_speed: Desired speed on a free road [m/s]; None uses the initial speed.
        changes_lanes: Whether it may change lanes.
        oncoming: Whether it drives against the road's direction.

    Raises:
        SettingsError: If a number is not finite or a speed is not positive.
    """

    x: float = OBSTACLE_START[0]
    y: float = OBSTACLE_START[1]
    speed: float = OBSTACLE_SPEED
    target_speed: float | None = None
    changes_lanes: bool = False
    oncoming: bool = False

    def __post_init__(self) -> None:
        _check(self, {"target_speed": None})
        for name in ("speed", "target_speed"):
            if getattr(self, name) == 0:
                raise SettingsError(f"{name} of a driver must be above 0 m/s, got 0")


class Track:
    """The path that a `Driver` has driven so far, straight between two instants.

    This matches highway-env, which keeps speed and direction constant for a step.
    """

    def __init__(self) -> None:
        self._t: list[float] = []
        self._rows: list[tuple[float, float, float, float]] = []
        self._arrays: tuple[Times, Float[np.ndarray, "K 4"]] | None = None

    def add(self, t: float, pose: Sequence[float], speed: float) -> None:
        """Append pose and speed along the road [m/s] at `t` [s]."""
        x, y, turned = pose
        self._t.append(t)
        self._rows.append((x, y, turned, speed))
        self._arrays = None

    def poses(self, t: Times) -> Poses:
        """Return the poses at the times `t` [s], shape (K, 3)."""
        at, rows = self._known()
        return np.stack([np.interp(t, at, rows[:, i]) for i in range(3)], axis=1)

    def speeds(self, t: Times) -> Times:
        """Return the speed along the road at the times `t` [s], m/s, shape (K,)."""
        at, rows = self._known()
        return np.asarray(np.interp(t, at, rows[:, 3]))

    def _known(self) -> tuple[Times, Float[np.ndarray, "K 4"]]:
        if self._arrays is None:
            self._arrays = np.array(self._t), np.array(self._rows)
        return self._arrays


def upright(turned: float) -> float:
    """Return a body's angle from the road's direction, within ±π/2: rectangles have no front."""
    return (turned + pi / 2) % pi - pi / 2


def rows(movers: Sequence[Mover], t: Times) -> Float[np.ndarray, "K n 3"]:
    """Return (x_o, y_o [m], v_o [m/s]) of each vehicle at the times `t` [s], shape (K, n, 3)."""
    each = [np.column_stack([o.poses(t)[:, :2], o.speeds(t)]) for o in movers]
    return np.stack(each, axis=1)


def _check(vehicle: Obstacle | Driver, may_be: dict[str, None]) -> None:
    kind = type(vehicle).__name__.lower()
    for field in fields(vehicle):
        value = getattr(vehicle, field.name)
        if field.name in may_be and value is None:
            continue
        if isinstance(field.default, bool):
            if not isinstance(value, bool):
                raise SettingsError(f"{kind}: {field.name} must be true or false, got {value!r}")
            continue
        low = _LOWEST.get(field.name, 0.0)
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not (number and np.isfinite(value) and value >= low):
            raise SettingsError(
                f"{kind}: {field.name} must be finite"
                + (f" and at least {low:g}" if np.isfinite(low) else "")
                + f", got {value!r}"
            )
