"""A problem of the benchmark: knobs, how a θ runs, and who can answer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from prefcal_bench.people import TASTES, USUAL, WRONG, Runs, has_cost, is_cached, sample, taste
from prefcal_env.calibrators import Flipping
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_scenarios.kpis import has_goals
from prefcal_scenarios.scenario import Scenario

from .person import Judge, Outcome, Person, person_of

JudgeFactory = Callable[[int], Judge]

NOISES: Mapping[str, float] = {end[1:]: share for end, share in WRONG.items() if end}
"""Share of answers that are flipped, by the name of the calibrator."""
_READ: dict[tuple[str, str, str], Runs] = {}
"""Samples of this process: reading one takes longer than a question."""


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
