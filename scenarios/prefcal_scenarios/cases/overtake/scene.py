"""Read phases, obstacles and distances from the signals of an overtaking experiment."""

from itertools import pairwise

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


def obstacles(experiment: Experiment) -> Float[np.ndarray, "n K 2"]:
    """Return front ends (x_o, y_o) [m] of each obstacle on `experiment.t`, shape (n, K, 2)."""
    return bodies(experiment)[:, :, :2]


def bodies(experiment: Experiment) -> Float[np.ndarray, "n K 3"]:
    """Return poses (x_o, y_o [m], angle [rad]) of each obstacle on `experiment.t`, (n, K, 3)."""
    signals, straight = experiment.signals, np.zeros(len(experiment.t))
    names = [k[:-2] for k in signals if k.startswith("obstacle") and k.endswith("_x")]
    found = [
        np.column_stack(
            [signals[f"{n}_x"], signals[f"{n}_y"], signals.get(f"{n}_yaw", straight)]
        )
        for n in names
    ]  # fmt: skip
    return np.stack(found) if found else np.zeros((0, len(experiment.t), 3))


def road_of(experiment: Experiment) -> tuple[float, float]:
    """Return right and left edge of the road, y [m]."""
    left = experiment.signals.get("road_left", np.zeros(0))
    return ROAD[0], float(left.max(initial=ROAD[1]))


def clearance(experiment: Experiment) -> float:
    """Return the smallest distance of the outlines [m]: 0 on contact, inf without an obstacle."""
    pose = experiment.x[:, :3]
    return min((float(distance(pose, o).min()) for o in bodies(experiment)), default=np.inf)


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

    They are: overtaking begins, the lane is changed, beside the first obstacle, overtaking ends,
    and back in the lane, or the end of the run. If the run misses any other of these, they are
    equally spaced from the start of overtaking (or of the run) to its end.
    """
    t, x, y = experiment.t, experiment.x[:, 0], experiment.x[:, 1]
    overtaking = phases(experiment) == Phase.OVERTAKING
    begin, last = _first(overtaking, 0), len(t) - 1
    ahead = obstacles(experiment)[:1, :, 0]
    beside = _first(np.asarray((x >= ahead).any(axis=0)), begin or 0)
    end = _first(~overtaking, begin or 0)
    if begin is not None and beside is not None and end is not None:
        home = _first(np.abs(y) <= _HOME, end)
        changing = int(np.argmin(np.abs(t - (t[begin] + t[beside]) / 2)))
        found = [begin, changing, beside, end, last if home is None else home]
        if all(a < b for a, b in pairwise(found)):
            return found
    spaced = np.linspace(t[begin or 0], t[-1], 5)
    return [int(np.abs(t - s).argmin()) for s in spaced]


def _first(holds: Bool[np.ndarray, " K"], start: int) -> int | None:
    found = np.flatnonzero(holds[start:])
    return start + int(found[0]) if len(found) else None
