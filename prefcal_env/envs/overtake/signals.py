"""What an experiment keeps beside states and inputs, on its dense instants."""

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.contact import Times
from prefcal_env.envs.overtake.geometry import Poses, lateral_distance, outside, separation
from prefcal_env.envs.overtake.traffic import Obstacle
from prefcal_env.overtaking import (
    KEEPING_SPEED,
    KEEPING_SPEEDS,
    OVERTAKING_SPEED,
    OVERTAKING_SPEEDS,
    Phase,
    gap,
)

Signal = Float[np.ndarray, " K"]


def signals_of(
    t: Times, poses: Poses, phases: Signal, obstacles: tuple[Obstacle, ...]
) -> dict[str, Signal]:
    """All signals by name, each shape (K,).

    `obstacle_x`, `obstacle_y` [m], `obstacle_v` [m/s], and `obstacle2_x` ... for further ones.
    `gap` [m]: x_o - 4.5 - x_f to the obstacle that is nearest along the road.
    `lateral_distance` [m]: the smallest to those alongside; NaN where there is none.
    `separation` [m]: at least so far apart are the bodies; below 1e-3 where they touched.
    `outside` [m]: how far the outermost corner is off the road, negative inside.
    `phase`: 0 lane keeping, 1 overtaking, held from sampling instants on.
    `speed_reference`, `speed_low` [m/s]: of v, in that phase.
    """
    others = [obstacle.poses(t) for obstacle in obstacles]
    named: dict[str, Signal] = {}
    for i, (obstacle, other) in enumerate(zip(obstacles, others, strict=True), start=1):
        name = "obstacle" if i == 1 else f"obstacle{i}"
        named |= {f"{name}_x": other[:, 0], f"{name}_y": other[:, 1]}
        named[f"{name}_v"] = obstacle.speeds(t)
    overtaking = phases == Phase.OVERTAKING
    return named | {
        "gap": nearest_gap(poses[:, 0], np.array([other[:, 0] for other in others])),
        "lateral_distance": _smallest([lateral_distance(poses, other) for other in others]),
        "separation": _smallest([separation(poses, other) for other in others]),
        "outside": outside(poses),
        "phase": phases,
        "speed_reference": np.where(overtaking, OVERTAKING_SPEED, KEEPING_SPEED),
        "speed_low": np.where(overtaking, OVERTAKING_SPEEDS[0], KEEPING_SPEEDS[0]),
    }


def nearest_gap(x_f: Signal, x_o: Float[np.ndarray, "n K"]) -> Signal:
    """`gap` to the obstacle whose front end is nearest along the road [m], shape (K,)."""
    nearest = np.abs(x_o - x_f).argmin(axis=0)
    return np.asarray(gap(0.0, x_o[nearest, np.arange(len(x_f))] - x_f))


def _smallest(values: list[Signal]) -> Signal:
    """The smallest at each instant, shape (K,); NaN only where all are."""
    return np.asarray(np.fmin.reduce(values))
