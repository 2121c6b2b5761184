"""The other vehicles, and the signals of an experiment that depend on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float

from .geometry import Poses, Times, lateral_distance, outside, separation
from .rules import (
    KEEPING_SPEED,
    KEEPING_SPEEDS,
    LANE_WIDTH,
    MIN_LATERAL_DISTANCE,
    OBSTACLE_SPEED,
    OBSTACLE_START,
    OVERTAKING_SPEED,
    OVERTAKING_SPEEDS,
    ROAD,
    SAFETY_DISTANCE,
    Phase,
    clearance,
    gap,
)

Signal = Float[np.ndarray, " K"]
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


def signals_of(
    t: Times, poses: Poses, phases: Signal, movers: Sequence[Mover], road: tuple[float, float] = ROAD
) -> dict[str, Signal]:
    """Return all signals by name, each of shape (K,).

    `obstacle_x`, `obstacle_y` [m], `obstacle_v` [m/s], and `obstacle2_x` ... for further ones;
    `obstacle_yaw` [rad] of one that turns: the angle of its body from the road's direction.
    `road_left` [m]: the left edge, if the road is not the paper's.
    `gap` [m]: x_o - 4.5 - x_f to the obstacle that is nearest along the road.
    `lateral_distance` [m]: the smallest to obstacles alongside; NaN if there are none.
    `separation` [m]: a lower bound on the distance of the bodies; below 1e-3 if they touched.
    `outside` [m]: how far the outermost corner is off the road, negative if inside.
    `phase`: 0 lane keeping, 1 overtaking, held from sampling instants on.
    `speed_reference`, `speed_low` [m/s]: reference and lower limit of v in that phase.
    `lateral_reference` [m]: reference of y_f; 0, or while overtaking 3 m left of the obstacle.
    """
    places = [mover.at(t) for mover in movers]
    others = [place[:, :3] for place in places]
    named: dict[str, Signal] = {}
    for i, place in enumerate(places, start=1):
        name = "obstacle" if i == 1 else f"obstacle{i}"
        named |= {f"{name}_x": place[:, 0], f"{name}_y": place[:, 1], f"{name}_v": place[:, 3]}
        if place[:, 2].any():
            named[f"{name}_yaw"] = place[:, 2]
    if road != ROAD:
        named["road_left"] = np.full(len(t), road[1])
    overtaking = phases == Phase.OVERTAKING
    return named | {
        "gap": _nearest_gap(poses[:, 0], np.array([other[:, 0] for other in others])),
        "lateral_distance": _smallest([lateral_distance(poses, other) for other in others]),
        "separation": _smallest([separation(poses, other) for other in others]),
        "outside": outside(poses, road),
        "phase": phases,
        "speed_reference": np.where(overtaking, OVERTAKING_SPEED, KEEPING_SPEED),
        "lateral_reference": _lateral_reference(poses[:, 0], others, overtaking),
        "speed_low": np.where(overtaking, OVERTAKING_SPEEDS[0], KEEPING_SPEEDS[0]),
    }


def _lateral_reference(x_f: Signal, others: list[Poses], overtaking: Bool[np.ndarray, " K"]) -> Signal:
    """Return the reference of y_f [m], shape (K,): 3 m beside the leftmost near obstacle, as tuned.

    Once no obstacle is near, the reference keeps its value until the overtaking ends.
    """
    line = np.full(len(x_f), -np.inf)
    for other in others:
        ahead, y_o = other[:, 0] - x_f, other[:, 1]  # [m], from the ego front end to the other's
        near = (gap(0.0, ahead) < SAFETY_DISTANCE) & (clearance(0.0, ahead) <= SAFETY_DISTANCE)
        line = np.where(near & (y_o < LANE_WIDTH / 2), np.maximum(line, y_o), line)
    known = np.maximum.accumulate(np.where(np.isfinite(line), np.arange(len(line)), -1))
    held = np.where(known >= 0, line[known], 0.0)
    return np.where(overtaking, held + MIN_LATERAL_DISTANCE, 0.0)


def _nearest_gap(x_f: Signal, x_o: Float[np.ndarray, "n K"]) -> Signal:
    """Return `gap` to the obstacle whose front end is nearest along the road [m], shape (K,)."""
    nearest = np.abs(x_o - x_f).argmin(axis=0)
    return np.asarray(gap(0.0, x_o[nearest, np.arange(len(x_f))] - x_f))


def _smallest(values: list[Signal]) -> Signal:
    """Return the smallest value at each instant, shape (K,); NaN only if all values are NaN."""
    return np.asarray(np.fmin.reduce(values))
