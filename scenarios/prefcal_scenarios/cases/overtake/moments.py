"""Choose the five moments of an overtaking at which figures show the vehicles."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.envs.overtake.road.rules import Phase
from prefcal_env.experiments.experiment import Experiment

from .scene import obstacles, phases

_HOME = 0.1
"""|y_f| at which the car is back in its lane [m]."""


@dataclass(frozen=True, slots=True)
class Moment:
    """An instant of an experiment, `index` into its `t`, and what happens there, if known."""

    index: int
    name: str = ""


def moments(experiment: Experiment) -> tuple[Moment, ...]:
    """Return five moments: begin, lane change, beside the obstacle, end, back in the lane.

    A run that ends on its way back shows its end instead. If it misses any of the others, the five
    moments are equally spaced from the start of overtaking (or of the run) to its end.
    """
    t = experiment.t
    begin, beside, end, home = _instants(experiment)
    if begin is not None and beside is not None and end is not None:
        changing = _nearest(t, (t[begin] + t[beside]) / 2)
        indices = [begin, changing, beside, end, len(t) - 1 if home is None else home]
        if all(a < b for a, b in pairwise(indices)):
            last = "ends on its way" if home is None else "back in lane"
            names = ["begins", "changes lane", "beside", "turns back", last]
            return tuple(Moment(i, n) for i, n in zip(indices, names, strict=True))
    return tuple(Moment(_nearest(t, s)) for s in np.linspace(t[begin or 0], t[-1], 5))


def _instants(experiment: Experiment) -> tuple[int | None, int | None, int | None, int | None]:
    """Return begin, beside the first obstacle, end, back in the lane; None if it never happens."""
    overtaking = phases(experiment) == Phase.OVERTAKING
    begin = _first(overtaking)
    if begin is None:
        return None, None, None, None
    x, y = experiment.x[:, 0], experiment.x[:, 1]
    others = obstacles(experiment)
    beside = None if len(others) == 0 else _first(x >= others[0, :, 0], begin)
    end = _first(~overtaking, begin)
    home = None if end is None else _first(np.abs(y) <= _HOME, end)
    return begin, beside, end, home


def _first(holds: Bool[np.ndarray, " K"], start: int = 0) -> int | None:
    found = np.flatnonzero(holds[start:])
    return start + int(found[0]) if len(found) else None


def _nearest(t: Float[np.ndarray, " K"], instant: float) -> int:
    return int(np.argmin(np.abs(t - instant)))
