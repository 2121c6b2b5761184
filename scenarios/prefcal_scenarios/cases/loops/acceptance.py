"""Whether a loop is worth tuning, so that the generator of random loops returns no other."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Experiment

from .loop import Loop

_SETTLED = 0.05
"""Smallest share of the runs that settle before the disturbance."""
_UNSAFE = 0.8
"""Largest share of the runs that are interrupted."""
_SAME = 0.95
"""Largest share of the safe runs that may agree in a KPI."""


def is_worth_tuning(loop: Loop) -> bool:
    """Return whether random θ show that tuning `loop` is possible and matters.

    This runs `loop.sample` random θ, the same ones each time. At least 5 % of the runs settle
    before the disturbance, so that there is something to find; at most 80 % are interrupted, so
    that an agent is not only told what is unsafe; and no KPI has one value in more than 95 % of
    the safe runs, so that each one can decide.
    """
    rng = np.random.default_rng(0)
    points = rng.random((loop.sample, len(loop.space)))
    return are_worth_comparing([loop.run(loop.space.decode(z)) for z in points])


def are_worth_comparing(runs: Sequence[Experiment]) -> bool:
    """Return whether runs of random θ satisfy the rules of `is_worth_tuning`."""
    safe = [run for run in runs if run.end is End.TIME_UP]
    settled = sum(bool(np.isfinite(run.kpis["settling_time"])) for run in safe)
    if settled < _SETTLED * len(runs) or len(safe) < (1 - _UNSAFE) * len(runs):
        return False
    most = (Counter(run.kpis[name] for run in safe).most_common(1)[0][1] for name in safe[0].kpis)
    return all(count <= _SAME * len(safe) for count in most)
