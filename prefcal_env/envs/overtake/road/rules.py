"""The overtaking of section IV-B: its numbers, and when to overtake. For controller and scene.

Positions are those of front ends on the centre line: x ahead, y to the left [m].
"""

from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_env.plants.bicycle import KMH

Position = TypeVar("Position", float, np.ndarray[Any, Any])
"""One x [m], or several, shape (n,)."""

LENGTH, WIDTH = 4.5, 1.8
"""Of every vehicle [m]."""
LANE_WIDTH = 4.0
"""Two lanes, centred at y = 0 and at y = `LANE_WIDTH` [m]; the paper has no number."""
ROAD = (-LANE_WIDTH / 2, 1.5 * LANE_WIDTH)
"""Right and left edge of the road, y [m]."""
SAFETY_DISTANCE = 10.0
"""Overtaking begins when the gap falls below it, and ends when it is as large behind [m]."""
MIN_LATERAL_DISTANCE = 3.0
"""Between the centre lines while overtaking [m]."""
HORIZON = 15.0
"""An experiment lasts until the first sample at or after it [s]."""
T_S_RANGE = (0.085, 0.5)
"""Sampling times [s]."""
START = (0.0, 0.0, 0.0)
"""x_f [m], y_f [m] and θ [rad] of the own vehicle."""
KEEPING_SPEED, OVERTAKING_SPEED = 50 * KMH, 60 * KMH
"""References of v in the two phases [m/s]."""
KEEPING_SPEEDS, OVERTAKING_SPEEDS = (40 * KMH, 70 * KMH), (50 * KMH, 70 * KMH)
"""Limits of v in the two phases [m/s]."""
OBSTACLE_START, OBSTACLE_SPEED = (30.0, 0.0), 40 * KMH
"""Where the paper's obstacle starts [m], and how fast it drives straight ahead [m/s]."""


class Phase(IntEnum):
    """What the own vehicle is about."""

    LANE_KEEPING = 0
    OVERTAKING = 1


def next_phase(phase: Phase, x_f: float, obstacles: Float[np.ndarray, "n 3"]) -> Phase:
    """The phase at this sampling instant, from the one before (at first lane keeping). Pure.

    Source: section IV-B, "within safety distance"; geometry as stated in `gap` and `clearance`.
    Overtaking begins when 0 < gap < 10 m and lasts until the clearance is above 10 m.
    With several obstacles that holds for each in turn: once one is passed, it is over when the
    next is not within 10 m; before, falling back does not end it. Who drives in the left lane
    cannot be overtaken and is left out.

    Args:
        phase: At the sampling instant before.
        x_f: Front end of the own vehicle [m].
        obstacles: (x_o, y_o [m], v_o [m/s]) of each, shape (n, 3); n may be 0.
    """
    ahead = [x_o for x_o, y_o, _ in obstacles.tolist() if y_o < LANE_WIDTH / 2]
    if phase is Phase.LANE_KEEPING:
        begins = any(0 < gap(x_f, x_o) < SAFETY_DISTANCE for x_o in ahead)
        return Phase.OVERTAKING if begins else Phase.LANE_KEEPING
    to_pass = [x_o for x_o in ahead if clearance(x_f, x_o) <= SAFETY_DISTANCE]
    none_passed = len(to_pass) == len(ahead)
    goes_on = any(none_passed or gap(x_f, x_o) < SAFETY_DISTANCE for x_o in to_pass)
    return Phase.OVERTAKING if goes_on else Phase.LANE_KEEPING


def beside(x_f: float, obstacles: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """The obstacles to keep `MIN_LATERAL_DISTANCE` from: right lane, within 10 m before or behind.

    Args:
        x_f: Front end of the own vehicle [m].
        obstacles: As in `next_phase`, shape (n, 3).

    Returns:
        Their rows, shape (m, 3); m may be 0.
    """
    x_o, y_o = obstacles[:, 0], obstacles[:, 1]
    near = (gap(x_f, x_o) < SAFETY_DISTANCE) & (clearance(x_f, x_o) <= SAFETY_DISTANCE)
    return obstacles[near & (y_o < LANE_WIDTH / 2)]


def gap(x_f: float, x_o: Position) -> Position:
    """From the own front end to the obstacle's rear end, x_o - 4.5 - x_f [m]."""
    return x_o - LENGTH - x_f


def clearance(x_f: float, x_o: Position) -> Position:
    """From the obstacle's front end to the own rear end, x_f - 4.5 - x_o [m]."""
    return x_f - LENGTH - x_o
