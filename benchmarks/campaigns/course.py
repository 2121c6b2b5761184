"""How good the best so far is after each experiment of a study, for the other scripts."""

from collections.abc import Callable, Iterable
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.loop import Comparison


def best_after_each(
    agent: Any, steps: Iterable[Comparison], cost: Callable[[Experiment], float]
) -> list[float]:
    """Cost of the agent's best after each experiment, (n_max,); `steps` drive the agent.

    Some studies ask more questions than they run experiments. Such an answer may change who is
    the best, so it changes the last entry and adds none.
    """
    costs: dict[tuple[float, ...], float] = {}
    course: list[float] = []
    for step in steps:
        theta = tuple(step.query.challenger.theta.tolist())
        if theta not in costs:
            costs[theta] = cost(step.challenger)
            course.append(0.0)
        course[-1] = costs[tuple(agent.best.tolist())]
    return course
