"""Read phases, obstacles and distances from the signals of an overtaking experiment."""

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_env.envs.overtake.geometry import distance
from prefcal_env.envs.overtake.rules import ROAD, Phase
from prefcal_env.experiments.experiment import Experiment

_HOME = 0.1
"""|y_f| at which the car is back in its lane [m]."""


def phases(experiment: Experiment) -> Int[np.ndarray, " K"]:
    """Return the phase on `experiment.t`, values of `Phase`, shape (K,)."""
    return np.asarray(experiment.signals["phase"]).astype(int)


def phase_at_control(experiment: Experiment) -> Int[np.ndarray, " N"]:
    """Return the phase at each decision, shape (N,)."""
    return np.asarray(phases(experiment)[at_control(experiment)])


def at_control(experiment: Experiment) -> Int[np.ndarray, " N"]:
    """Return the indices of the N sampling instants in `experiment.t`, shape (N,)."""
    instants = experiment.t_control - 1e-9 * max(1.0, experiment.duration)
    return np.searchsorted(experiment.t, instants)


def obstacles(experiment: Experiment) -> Float[np.ndarray, "n K 3"]:
    """Return poses (x_o, y_o [m], angle [rad]) of each obstacle on `experiment.t`, (n, K, 3)."""
    signals, straight = experiment.signals, np.zeros(len(experiment.t))
    names = [k[:-2] for k in signals if k.startswith("obstacle") and k.endswith("_x")]
    found = np.zeros((len(names), len(experiment.t), 3))
    for pose, name in zip(found, names, strict=True):
        columns = [signals.get(f"{name}_{part}", straight) for part in ("x", "y", "yaw")]
        pose[:] = np.column_stack(columns)
    return found


def road_of(experiment: Experiment) -> tuple[float, float]:
    """Return right and left edge of the road, y [m]."""
    left = experiment.signals.get("road_left", np.zeros(0))
    return ROAD[0], float(left.max(initial=ROAD[1]))


def clearance(experiment: Experiment) -> float:
    """Return the smallest distance of the outlines [m]: 0 on contact, inf without an obstacle."""
    pose = experiment.x[:, :3]
    return min((float(distance(pose, o).min()) for o in obstacles(experiment)), default=np.inf)


def in_lane(experiment: Experiment) -> Bool[np.ndarray, " K"]:
    """Return where the car keeps its lane, shape (K,), without the way back after overtaking.

    The way back ends when |y_f| first falls to 0.1 m; a later overshoot counts. If the
    way back does not end, only its last instant counts.
    """
    keeping = phases(experiment) == Phase.LANE_KEEPING
    near = np.abs(experiment.x[:, 1]) <= _HOME
    found = keeping.copy()
    for first in np.flatnonzero(keeping & ~np.append(False, keeping[:-1])):
        ends = np.flatnonzero((near | ~keeping)[first:])
        found[first : first + ends[0] if len(ends) else len(keeping) - 1] = False
    return np.asarray(found)


def moments(experiment: Experiment) -> list[int]:
    """Return five instants, indices into `t`, at which a figure shows the vehicles.

    They are equally spaced, from where the overtaking begins (or from the start) until the car is
    back in its lane, or the run ends.
    """
    t, begin, end = experiment.t, 0, len(experiment.t) - 1
    overtaking = np.flatnonzero(phases(experiment) == Phase.OVERTAKING)
    if len(overtaking):
        begin, over = int(overtaking[0]), int(overtaking[-1])
        home = np.flatnonzero(np.abs(experiment.x[over:, 1]) <= _HOME)
        end = over + int(home[0]) if len(home) else end
    return [int(np.abs(t - s).argmin()) for s in np.linspace(t[begin], t[end], 5)]
