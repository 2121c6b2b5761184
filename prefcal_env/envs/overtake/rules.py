"""Overtaking of section IV-B: its constants, when to overtake, and what a state costs.

Positions are those of front ends on the center line: x ahead, y to the left [m].
"""

from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_env.plants.bicycle import KMH

Position = TypeVar("Position", float, np.ndarray[Any, Any])
"""One position x [m], or several, shape (n,)."""

LENGTH, WIDTH = 4.5, 1.8
"""Length and width of every vehicle [m]."""
LANE_WIDTH = 4.0
"""Width of each of the two lanes, centered at y = 0 and `LANE_WIDTH` [m]; not in the paper."""
ROAD = (-LANE_WIDTH / 2, 1.5 * LANE_WIDTH)
"""Right and left edge of the road, y [m]."""
SAFETY_DISTANCE = 10.0
"""Overtaking begins when the gap falls below it and ends when it is as large behind [m]."""
MIN_LATERAL_DISTANCE = 3.0
"""Smallest distance between the center lines while overtaking [m]."""
HORIZON = 15.0
"""Duration: an experiment lasts until the first sample at or after it [s]."""
T_S_RANGE = (0.085, 0.5)
"""Range of sampling times [s]."""
START = (0.0, 0.0, 0.0)
"""Initial x_f [m], y_f [m] and θ [rad] of the ego vehicle."""
KEEPING_SPEED, OVERTAKING_SPEED = 50 * KMH, 60 * KMH
"""References of v in the two phases [m/s]."""
KEEPING_SPEEDS, OVERTAKING_SPEEDS = (40 * KMH, 70 * KMH), (50 * KMH, 70 * KMH)
"""Limits of v in the two phases [m/s]."""
OBSTACLE_START, OBSTACLE_SPEED = (30.0, 0.0), 40 * KMH
"""Initial position [m] and constant speed [m/s] of the paper's obstacle."""
MISHAP_COST = 10.0
"""Stage cost for the rest of the horizon after a mishap [1/s]: no reasonable state costs as much,
so it never pays to end an episode."""


class Phase(IntEnum):
    """Phase of the drive: what the ego vehicle is doing."""

    LANE_KEEPING = 0
    OVERTAKING = 1


def next_phase(phase: Phase, x_f: float, obstacles: Float[np.ndarray, "n 3"]) -> Phase:
    """Return the phase at this sampling instant, given the previous one (at first lane keeping).

    Source: section IV-B, "within safety distance"; geometry as stated in `gap` and `clearance`.
    Overtaking begins when 0 < gap < 10 m and lasts until the clearance is above 10 m.
    With several obstacles this holds for each in turn: once one is passed, overtaking ends unless
    the next is within 10 m; before that, falling back does not end it. Obstacles in the left lane
    cannot be overtaken and are ignored.

    Args:
        phase: Phase at the previous sampling instant.
        x_f: Front end of the ego vehicle [m].
        obstacles: (x_o, y_o [m], v_o [m/s]) of each obstacle, shape (n, 3); n may be 0.
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
    """Return the obstacles to keep `MIN_LATERAL_DISTANCE` from: right lane, within 10 m.

    Args:
        x_f: Front end of the ego vehicle [m].
        obstacles: As in `next_phase`, shape (n, 3).

    Returns:
        Rows of the obstacles in the right lane at most 10 m ahead or behind, shape (m, 3); m may
        be 0.
    """
    near = [
        gap(x_f, x_o) < SAFETY_DISTANCE and clearance(x_f, x_o) <= SAFETY_DISTANCE and y_o < LANE_WIDTH / 2
        for x_o, y_o, _ in obstacles.tolist()
    ]
    return obstacles[near]


def gap(x_f: float, x_o: Position) -> Position:
    """Return the distance from the ego front end to the obstacle's rear, x_o - 4.5 - x_f [m]."""
    return x_o - LENGTH - x_f


def clearance(x_f: float, x_o: Position) -> Position:
    """Return the distance from the obstacle's front end to the ego rear, x_f - 4.5 - x_o [m]."""
    return x_f - LENGTH - x_o


def stage_cost(
    t: Float[np.ndarray, " M"], y: Float[np.ndarray, " M"], u: Float[np.ndarray, " 2"], phase: Phase
) -> float:
    """Return the cost of a period, 1/s: (Δv/20 km/h)² + mean of (Δy/3 m)² + (δ_s/45°)².

    Δv and Δy are the distances from 50 km/h and the ego lane, or while overtaking from 60 km/h and
    3 m to the left of it. Multiplied by the duration, the cost does not depend on T_s.

    Args:
        t: Instants of the period, with both ends [s], shape (M,).
        y: y_f at `t` [m], shape (M,).
        u: Held v [m/s] and δ_s [rad].
        phase: Phase at the start of the period.
    """
    overtaking = phase is Phase.OVERTAKING
    v_ref = OVERTAKING_SPEED if overtaking else KEEPING_SPEED
    y_ref = MIN_LATERAL_DISTANCE if overtaking else 0.0
    error = ((y - y_ref) / MIN_LATERAL_DISTANCE) ** 2
    lane = np.trapezoid(error, t) / (t[-1] - t[0]) if len(t) > 1 else error[0]
    v, steering = u.tolist()
    speed = ((v - v_ref) / (20 * KMH)) ** 2
    return float(speed + lane + (steering / (np.pi / 4)) ** 2)
