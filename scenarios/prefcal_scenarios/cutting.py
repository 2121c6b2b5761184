"""Cut runs short that can no longer win, by the KPIs that can only get worse."""

from collections.abc import Callable, Iterator

import numpy as np

from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.so_far import until
from prefcal_env.preferences.kpis import Outcome

from .kpis import bounds_of
from .scenario import Scenario

CHECKS = 25
"""How often the chance to win of a run is worked out, at equal distances in time."""


def cut(
    scenario: Scenario, experiment: Experiment, hopeless: Callable[[Outcome], bool]
) -> Experiment:
    """Return `experiment` up to the first instant at which it is `hopeless`, or as it is.

    A simulation ends before anybody can cut it short. Its record is cut where a run on a plant
    would have been, which takes as long to compute, but shows what a plant would save.

    Args:
        scenario: Scenario of the experiment.
        experiment: Whole run.
        hopeless: Function of lower bounds of the KPIs that returns whether such a run cannot win.

    Raises:
        ScenarioError: As in `bounds_of`.
    """
    for part in parts(experiment):
        if hopeless(bounds_of(scenario, part)):
            return part
    return experiment


def parts(experiment: Experiment, checks: int = CHECKS) -> Iterator[Experiment]:
    """Yield the record up to each of `checks` instants before its end, the shortest first."""
    if experiment.runs or experiment.end is End.CUT_SHORT or len(experiment.t) < 2:
        return
    for time in np.linspace(experiment.t[0], experiment.t[-1], checks + 1)[1:-1]:
        yield until(experiment, float(time))
