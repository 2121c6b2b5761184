"""Who answers in a study: the judge, what agents are told, and how the result is scored."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_bench.people import Runs, Taste, runs_of, worth
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Calibrator
from prefcal_scenarios.kpis import INTERRUPTED

Judge = Calibrator[Any]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of running a θ.

    Args:
        theta: Physical θ, shape (n,).
        cost: Latent cost, lower is better; None if the problem has none.
        experiment: Experiment; None for a test function.
        kpis: KPIs that an agent can learn from besides the answers; None for a test function.
    """

    theta: Float[np.ndarray, " n"]
    cost: float | None
    experiment: Experiment | None = None
    kpis: Mapping[str, float] | None = None

    @property
    def judged(self) -> "Experiment | Outcome":
        """Return what calibrators compare: the experiment, or this outcome of a test function."""
        return self if self.experiment is None else self.experiment


@dataclass(frozen=True)
class Person:
    """One person in one study.

    Args:
        judge: Calibrator that answers; a new one for each study.
        cost: Function that returns what value-based agents are told, lower is better.
        gap: Function that returns the difference of the cost to the best known one; None if it is
            not known.
        worth: Function that returns the worth, see `prefcal_bench.people.worth`; None if there
            is no pool.
        told: Function that returns the KPIs that agents are told besides the answers.
        withheld: Names of KPIs that agents are not told, also not of what they simulate.
    """

    judge: Judge
    cost: Callable[[Outcome], float | None] = attrgetter("cost")
    gap: Callable[[Outcome], float] | None = None
    worth: Callable[[Outcome], float] | None = None
    told: Callable[[Outcome], Mapping[str, float] | None] = attrgetter("kpis")
    withheld: frozenset[str] = frozenset()


def person_of(taste: Taste, pool: Runs) -> Person:
    """Return the person with this taste, whose θ are compared with those of `pool`."""
    withheld = frozenset(taste.withheld)
    return Person(
        judge=taste.calibrator(),
        cost=partial(_cost, taste),
        worth=partial(_worth, taste, pool),
        told=partial(_told, withheld),
        withheld=withheld,
    )


def _runs(taste: Taste, outcome: Outcome) -> Runs:
    assert outcome.experiment is not None
    return runs_of(taste.kpis, [outcome.experiment])


def _cost(taste: Taste, outcome: Outcome) -> float | None:
    cost = taste.rule.cost(_runs(taste, outcome))
    return None if cost is None else float(cost[0])


def _worth(taste: Taste, pool: Runs, outcome: Outcome) -> float:
    return worth(taste.rule, pool, _runs(taste, outcome))


def _told(withheld: frozenset[str], outcome: Outcome) -> Mapping[str, float] | None:
    """Return the KPIs without those in `withheld`, and then without generic ones, which hint."""
    if not withheld or outcome.kpis is None or outcome.experiment is None:
        return outcome.kpis
    named = {*outcome.experiment.kpis, INTERRUPTED} - withheld
    return {name: value for name, value in outcome.kpis.items() if name in named}
