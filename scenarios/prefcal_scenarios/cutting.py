"""Cut runs short that can no longer win, by the KPIs that can only get worse."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from prefcal_agents import GLISp
from prefcal_agents.glisp.cutting import HOPELESS
from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.so_far import until

from .kpis import bounds_of
from .scenario import Scenario

CHECKS = 25
"""How often the chance to win of a run is worked out, at equal distances in time."""


@dataclass(frozen=True, eq=False, slots=True)
class Chances:
    """What decides whether a run in progress can still become the best.

    Args:
        agent: Agent that was told the KPIs of all earlier experiments.
        scenario: Scenario of the run.
    """

    agent: GLISp
    scenario: Scenario

    def to_win(self, record: Experiment) -> float:
        """Return the probability that the run becomes the best, from its record so far."""
        return self.agent.chance_to_win(bounds_of(self.scenario, record))

    def is_hopeless(self, record: Experiment) -> bool:
        """Return whether it hardly pays to finish the run, from its record so far."""
        return self.to_win(record) < HOPELESS


def cut(experiment: Experiment, hopeless: Callable[[Experiment], bool]) -> Experiment:
    """Return `experiment` up to the first instant at which it is `hopeless`, or as it is.

    A simulation ends before anybody can cut it short. Its record is cut where a run on a plant
    would have been, which takes as long to compute, but shows what a plant would save.

    Args:
        experiment: Whole run.
        hopeless: Function of the record so far that returns whether the run cannot win, such as
            that of `Chances`.
    """
    for part in parts(experiment):
        if hopeless(part):
            return part
    return experiment


def parts(experiment: Experiment, checks: int = CHECKS) -> Iterator[Experiment]:
    """Yield the record up to each of `checks` instants before its end, the shortest first."""
    if experiment.runs or experiment.end is End.CUT_SHORT or len(experiment.t) < 2:
        return
    for time in np.linspace(experiment.t[0], experiment.t[-1], checks + 1)[1:-1]:
        yield until(experiment, float(time))
