"""Compute the KPIs of a car experiment, for the criteria (i) to (v)."""

from math import inf

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.geometry import CONTACT
from prefcal_env.envs.overtake.rules import (
    KEEPING_SPEED,
    LANE_WIDTH,
    LENGTH,
    MIN_LATERAL_DISTANCE,
    OVERTAKING_SPEED,
    Phase,
)
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.scenario import KPI

from .computation_time import t_comp
from .scene import clearance, in_lane, obstacles, phase_at_control

SHORTEST_DISTANCE = MIN_LATERAL_DISTANCE - 0.1
"""Smallest "reasonable safety distance" beside the obstacle, criterion (iii) [m]."""

KPIS = (
    KPI("t_comp_ratio", "worst t_comp / T_s", at_most=1.0),
    KPI("lateral_distance", "smallest lateral distance beside the obstacle", "m", at_least=SHORTEST_DISTANCE),
    KPI("path_peak", "largest y_f", "m", better="lower"),
    KPI("t_comp_worst", "worst t_comp, modeled", "s", better="lower"),
    KPI("t_comp_99", "t_comp, 99th percentile, modeled", "s", better="lower"),
    KPI("collision", "collisions", at_most=0.0),
    KPI("off_road", "largest distance outside the road", "m", at_most=0.0),
    KPI("clearance", "smallest clearance", "m", better="higher"),
    KPI("overtaking_time", "time of overtaking", "s", better="lower"),
    KPI("overshoot", "overshoot of y_f beyond its reference", "m", better="lower"),
    KPI("lane_deviation", "largest |y_f| in lane keeping", "m", better="lower"),
    KPI("lane_yaw", "largest |ψ| in lane keeping", "°", better="lower"),
    KPI("lateral_acceleration", "largest lateral acceleration", "m/s²", better="lower"),
    KPI("lateral_acceleration_rms", "RMS lateral acceleration", "m/s²", better="lower"),
    KPI("lateral_jerk", "largest lateral jerk", "m/s³", better="lower"),
    KPI("lateral_jerk_rms", "RMS lateral jerk", "m/s³", better="lower"),
    KPI("speed_error", "RMS error of v", "km/h", better="lower"),
    KPI("speed_variation", "total variation of v", "km/h", better="lower"),
    KPI("steering", "largest |δ_s|", "°", better="lower"),
    KPI("steering_move", "largest move of δ_s", "°", better="lower"),
    KPI("steering_rate", "largest rate of δ_s", "°/s", better="lower"),
    KPI("steering_rate_rms", "RMS rate of δ_s", "°/s", better="lower"),
    KPI("unsolved", "unsolved QPs", at_most=0.0),
)
"""KPIs, most important first. An infinite time means never, an infinite distance no obstacle."""


def compute_kpis(experiment: Experiment) -> dict[str, float]:
    """Return the values of `KPIS`, in their units."""
    seconds = t_comp(experiment)
    found = {
        "t_comp_worst": seconds.max(),
        "t_comp_99": np.percentile(seconds, 99),
        "t_comp_ratio": seconds.max() / experiment.theta[0],
        "overtaking_time": _overtaking_time(experiment),
        "unsolved": np.sum(~experiment.solved),
    }
    found |= _safety(experiment) | _path(experiment) | _inputs(experiment)
    return {kpi.name: float(found[kpi.name]) for kpi in KPIS}


def _safety(experiment: Experiment) -> dict[str, float]:
    signals = experiment.signals
    touched = experiment.end.interrupted and float(signals["separation"].min()) <= CONTACT
    beside = signals["lateral_distance"]
    return {
        "lateral_distance": float(np.min(beside, initial=inf, where=~np.isnan(beside))),
        "clearance": clearance(experiment),
        "collision": 1.0 if touched else 0.0,
        "off_road": max(float(signals["outside"].max()), 0.0),
    }


def _path(experiment: Experiment) -> dict[str, float]:
    y_f, yaw, kept = experiment.x[:, 1], experiment.x[:, 2], in_lane(experiment)
    # The paper's reference is 3 m to the left of the obstacles in the right lane.
    y_o = [o[:, 1].max() for o in obstacles(experiment) if o[0, 1] < LANE_WIDTH / 2]
    target = MIN_LATERAL_DISTANCE + float(max(y_o, default=0.0))
    return {
        "path_peak": float(y_f.max()),
        "overshoot": max(float(y_f.max()) - target, 0.0),
        "lane_deviation": float(np.abs(y_f[kept]).max(initial=0.0)),
        "lane_yaw": float(np.degrees(np.abs(yaw[kept]).max(initial=0.0))),
    }


def _inputs(experiment: Experiment) -> dict[str, float]:
    """Return what follows from the inputs: comfort, speed and steering.

    The lateral acceleration is that of the rear axle, v² sin(2 δ_s)/(2 L) [m/s²]. Its velocity
    v cos δ_s has the direction of the yaw angle, which changes by v sin δ_s/L; at the front the
    acceleration would jump with the steering angle.
    """
    T_s, (v, angle) = float(experiment.theta[0]), experiment.u_control.T
    a = v**2 * np.sin(2 * angle) / (2 * LENGTH)
    jerk = np.diff(a, prepend=0.0) / T_s
    overtaking = phase_at_control(experiment) == Phase.OVERTAKING
    reference = np.where(overtaking, OVERTAKING_SPEED, KEEPING_SPEED)
    steering = np.degrees(angle)
    moves = np.diff(steering, prepend=0.0)
    return {
        "lateral_acceleration": np.abs(a).max(),
        "lateral_acceleration_rms": _rms(a),
        "lateral_jerk": np.abs(jerk).max(),
        "lateral_jerk_rms": _rms(jerk),
        "speed_error": _rms(v - reference) / KMH,
        "speed_variation": np.abs(np.diff(v, prepend=KEEPING_SPEED)).sum() / KMH,
        "steering": np.abs(steering).max(),
        "steering_move": np.abs(moves).max(),
        "steering_rate": np.abs(moves).max() / T_s,
        "steering_rate_rms": _rms(moves) / T_s,
    }


def _overtaking_time(experiment: Experiment) -> float:
    """Return the time from the decision to overtake to the decision to keep the lane again [s]."""
    overtaking = phase_at_control(experiment) == Phase.OVERTAKING
    begun = np.flatnonzero(overtaking)
    if len(begun) == 0:
        return inf
    over = np.flatnonzero(~overtaking[begun[0] :])
    if len(over) == 0:
        return inf
    first, last = begun[0], begun[0] + over[0]
    return float(experiment.t_control[last] - experiment.t_control[first])


def _rms(values: Float[np.ndarray, " N"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
