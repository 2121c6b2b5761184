"""The stage cost of the car for speed, lane and steering, and the cost of a mishap."""

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.rules import (
    KEEPING_SPEED,
    MIN_LATERAL_DISTANCE,
    OVERTAKING_SPEED,
    Phase,
)
from prefcal_env.plants.bicycle import KMH

_SPEED_SCALE, _LANE_SCALE, _STEERING_SCALE = 20 * KMH, MIN_LATERAL_DISTANCE, np.pi / 4
MISHAP_COST = 10.0
"""Stage cost for the rest of the horizon after a mishap [1/s]: no reasonable state costs as much,
so it never pays to end an episode."""


def stage_cost(
    t: Float[np.ndarray, " M"],
    y: Float[np.ndarray, " M"],
    u: Float[np.ndarray, " 2"],
    phase: Phase,
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
    error = ((y - y_ref) / _LANE_SCALE) ** 2
    lane = np.trapezoid(error, t) / (t[-1] - t[0]) if len(t) > 1 else error[0]
    v, steering = u.tolist()
    speed = ((v - v_ref) / _SPEED_SCALE) ** 2
    return float(speed + lane + (steering / _STEERING_SCALE) ** 2)
