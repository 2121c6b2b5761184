"""A problem of the benchmark: knobs, how a θ runs, and who can answer and what they are told."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_bench.people import (
    TASTES,
    USUAL,
    WRONG,
    Runs,
    Taste,
    has_cost,
    is_cached,
    runs_of,
    sample,
    taste,
    worth,
)
from prefcal_bench.people.flipping import Flipping
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Answer, Calibrator, Preference
from prefcal_scenarios.runs import INTERRUPTED, has_goals
from prefcal_scenarios.scenario import Scenario

Judge = Calibrator[Any]
JudgeFactory = Callable[[int], Judge]

NOISES: Mapping[str, float] = {end[1:]: share for end, share in WRONG.items() if end}
"""Share of answers that are flipped, by the name of the calibrator."""
_READ: dict[tuple[str, str, str], Runs] = {}
"""Samples of this process: reading one takes longer than a question."""


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


@dataclass(frozen=True)
class Problem:
    """Problem of the benchmark.

    Args:
        name: Name in tables and on the command line.
        space: Knobs of the problem.
        run: Function that runs a physical θ, shape (n,), inside the box.
        calibrators: Calibrators by name, each a function of a seed.
        referee: Noise-free judge of final results, the same for every calibrator.
        best_known: Smallest known cost outside holes (see `HOLES`), from which gaps are measured;
            None if the problem has no cost.
        paper: Paper's optimum, physical, shape (n,), to compare with if there is no cost.
        version: Version, raised when the same θ has another outcome, or calibrators answer
            differently.
        scenario: Scenario whose KPIs tastes judge; None if there are no tastes.
        plant: Scenario of the experiments if `scenario` is None; None if there are no KPIs.

    Raises:
        SettingsError: If there are calibrators without a referee.
    """

    name: str
    space: KnobSpace
    run: Callable[[Float[np.ndarray, " n"]], Outcome]
    calibrators: Mapping[str, JudgeFactory]
    referee: Judge | None = None
    best_known: float | None = None
    paper: Float[np.ndarray, " n"] | None = None
    version: int | str = 1
    scenario: Scenario | None = None
    plant: Scenario | None = None

    def __post_init__(self) -> None:
        if self.calibrators and self.referee is None:
            raise SettingsError(f"problem {self.name!r} has calibrators, and so needs a referee")

    @property
    def has_cost(self) -> bool:
        """Return whether experiments have a cost of their own, from which gaps are measured."""
        return self.best_known is not None

    @property
    def answering(self) -> tuple[str, ...]:
        """Return the names of everyone who can answer: calibrators, and tastes."""
        tastes = TASTES if self.scenario is not None and has_goals(self.scenario) else ()
        return (*self.calibrators, *tastes)

    @property
    def simulated(self) -> Scenario | None:
        """Return the scenario whose KPIs agents that simulate are given; None if there is none."""
        return self.scenario or self.plant

    @property
    def kpi_names(self) -> tuple[str, ...]:
        """Return the names of the KPIs that results record."""
        return () if self.scenario is None else tuple(kpi.name for kpi in self.scenario.kpis)

    def has_value(self, calibrator: str) -> bool:
        """Return whether agents can be told the value that this calibrator's answers follow."""
        return has_cost(calibrator) or (self.has_cost and calibrator == "perfect")

    def person(self, calibrator: str, seed: int) -> Person:
        """Return the person who answers in one study.

        Raises:
            SettingsError: If there is no such calibrator or taste.
        """
        if calibrator in self.calibrators:
            gap = self.gap if self.has_cost else None
            return Person(self.calibrators[calibrator](seed), gap=gap)
        if calibrator not in self.answering or self.scenario is None:
            raise SettingsError(
                f"calibrator of {self.name} must be one of {', '.join(self.answering)}, got {calibrator!r}"
            )
        usual, pool = self._runs(USUAL), self._runs("pool")
        return person_of(taste(calibrator, self.scenario.kpis, usual, seed), pool)

    def prepare(self) -> None:
        """Compute the random experiments that tastes need, unless they are in the cache folder."""
        if self.scenario is not None:
            self._runs(USUAL)
            self._runs("pool")

    @property
    def is_prepared(self) -> bool:
        """Return whether `prepare` has nothing to compute."""
        return self.scenario is None or all(is_cached(self.scenario, name) for name in (USUAL, "pool"))

    def _runs(self, name: str) -> Runs:
        """Return the random experiments called `name`, read once in each process."""
        assert self.scenario is not None
        key = (self.name, str(self.version), name)
        if key not in _READ:
            _READ[key] = sample(self.scenario, name)
        return _READ[key]

    def outcome(self, theta: Float[np.ndarray, " n"]) -> Outcome:
        """Run θ, physical, shape (n,).

        Raises:
            KnobError: If θ does not fit the space.
        """
        return self.run(self.space.check(theta))

    def gap(self, outcome: Outcome) -> float:
        """Return the noise-free difference of the cost to the best known one, negative in a hole.

        Raises:
            SettingsError: If the problem has no cost.
        """
        if self.best_known is None or outcome.cost is None:
            raise SettingsError(f"problem {self.name!r} has no cost, and so no gap")
        return outcome.cost - self.best_known


def prefer(judge: Judge, challenger: Outcome, incumbent: Outcome) -> Preference:
    """Return the verdict of `judge` on two outcomes. Raises SettingsError if it abstains."""
    verdict = Answer.of(judge.prefer(challenger.judged, incumbent.judged)).preference
    if verdict is None:
        raise SettingsError("calibrators of the benchmark must decide, got an abstention")
    return verdict


def judges(referee: Judge, name: str) -> dict[str, JudgeFactory]:
    """Return the `referee` under `name`, and calibrators that are sometimes wrong."""
    noisy = {noise: partial(Flipping, referee, share) for noise, share in NOISES.items()}
    return {name: partial(same, referee), **noisy}


def same(judge: Judge, seed: int) -> Judge:
    """Return the same judge for any seed."""
    return judge
