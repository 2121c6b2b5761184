"""Problems on which agents are compared: test functions, the reactor, and the overtaking."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.calibrators import Flipping, LatentCost
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer, Calibrator, Preference
from prefcal_scenarios.cases.functions import FUNCTIONS, TestFunction
from prefcal_scenarios.scenario import Scenario

CSTR_BROAD = 0.69066
"""Smallest known eq. perf_index of a CSTR run that does not undershoot the accepted band.

Attained at θ = (0.25, 25, -1.000783). Gaps are measured from it, since it is the bottom of the
basin that answers lead to and that people would accept. Source: `benchmarks/checks/best_known.py`.
"""
CSTR_HOLE = 0.41508
"""Smallest known eq. perf_index in the whole box, at θ = (0.25, 4, -0.98486).

It lies in a crease about 0.09 wide in log Q, where C_A undershoots the target by 0.49 kgmol/m³,
which the index does not count, and ends on the target by chance.
Source: `benchmarks/checks/best_known.py`, docs/reactor_index.md.
"""
HOLES: Mapping[str, float] = {"cstr": CSTR_BROAD - CSTR_HOLE}
"""How far below `best_known` a problem's cost can fall in a hole that gaps exclude."""

GUIDELINES = "cstr-guidelines"
"""Name of the problem of the reactor, judged by criteria in their order."""

NOISES: Mapping[str, float] = {"noisy10": 0.1, "noisy20": 0.2}
"""Share of answers that are flipped, by the name of the calibrator."""

Judge = Calibrator[Any]
JudgeFactory = Callable[[int], Judge]


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
    """

    name: str
    space: KnobSpace
    run: Callable[[Float[np.ndarray, " n"]], Outcome]
    calibrators: Mapping[str, JudgeFactory]
    referee: Judge
    best_known: float | None = None
    paper: Float[np.ndarray, " n"] | None = None
    version: int = 1

    @property
    def has_cost(self) -> bool:
        """Return whether experiments have a cost that value-based agents can use."""
        return self.best_known is not None

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


@cache
def problem(name: str) -> Problem:
    """Return the problem called `name`, one of `PROBLEMS`.

    Raises:
        SettingsError: If there is no such problem.
    """
    if name not in PROBLEMS:
        raise SettingsError(f"problem must be one of {', '.join(PROBLEMS)}, got {name!r}")
    if name in FUNCTIONS:
        return _of_function(FUNCTIONS[name])
    return {"cstr": _reactor, GUIDELINES: _guidelines, "overtake": _overtaking}[name]()


def prefer(judge: Judge, challenger: Outcome, incumbent: Outcome) -> Preference:
    """Return the verdict of `judge` on two outcomes. Raises SettingsError if it abstains."""
    verdict = Answer.of(judge.prefer(challenger.judged, incumbent.judged)).preference
    if verdict is None:
        raise SettingsError("calibrators of the benchmark must decide, got an abstention")
    return verdict


def judges(referee: Judge, name: str) -> dict[str, JudgeFactory]:
    """Return the `referee` under `name`, and calibrators that are sometimes wrong."""
    noisy = {noise: partial(Flipping, referee, share) for noise, share in NOISES.items()}
    return {name: partial(_sure, referee), **noisy}


def _sure(judge: Judge, seed: int) -> Judge:
    """Return the same judge for any seed."""
    return judge


def _cost(outcome: Any) -> float:
    """Return the cost of an outcome, which test functions use in place of an experiment."""
    if outcome.cost is None:
        raise SettingsError("outcomes without a cost cannot be compared by it")
    return float(outcome.cost)


def _of_function(function: TestFunction) -> Problem:
    def run(theta: Float[np.ndarray, " n"]) -> Outcome:
        return Outcome(theta, function(theta))

    referee = LatentCost(_cost)
    return Problem(
        name=function.name,
        space=function.space,
        run=run,
        calibrators=judges(referee, "perfect"),
        referee=referee,
        best_known=function.optimum,
    )


def _reactor() -> Problem:
    """Return the paper's reactor, judged by its index."""
    from prefcal_scenarios.cases.cstr.scenario import synthetic

    referee = synthetic()
    return Problem(
        name="cstr",
        space=_cstr().space,
        run=_run_reactor,
        calibrators=judges(referee, "perfect"),
        referee=referee,
        best_known=CSTR_BROAD,
        version=2,
    )


def _guidelines() -> Problem:
    """Return the same reactor, judged by the paper's guidelines in their order.

    Answers by the guidelines do not follow the index, so it cannot score the result. As in the
    overtaking, the returned θ are compared with each other by the guidelines.
    """
    from prefcal_scenarios.cases.cstr.scenario import lexicographic

    referee = lexicographic()
    scenario = _cstr()

    def run(theta: Float[np.ndarray, " 3"]) -> Outcome:
        return replace(_run_reactor(theta), cost=None)

    return Problem(
        name=GUIDELINES,
        space=scenario.space,
        run=run,
        calibrators={"lexicographic": partial(_sure, referee)},
        referee=referee,
        paper=scenario.references["paper, preferences"],
    )


def _cstr() -> Scenario:
    from prefcal_scenarios.cases.cstr import cstr  # imports solvers

    return cstr


def _run_reactor(theta: Float[np.ndarray, " 3"]) -> Outcome:
    """Run one experiment of the reactor, with its index and its KPIs."""
    from prefcal_scenarios.kpis import outcome

    scenario = _cstr()
    experiment = scenario.run(theta)
    assert scenario.cost is not None
    cost = float(scenario.cost(experiment))
    return Outcome(theta, cost, experiment, outcome(scenario, experiment))


def _overtaking() -> Problem:
    """Return the paper's overtaking, judged by criteria in their order, without a cost."""
    from prefcal_scenarios.cases.overtake import overtake as scenario
    from prefcal_scenarios.cases.overtake.criteria import synthetic
    from prefcal_scenarios.kpis import outcome

    def run(theta: Float[np.ndarray, " 5"]) -> Outcome:
        experiment = scenario.run(theta)
        return Outcome(theta, None, experiment, outcome(scenario, experiment))

    referee = synthetic()
    return Problem(
        name="overtake",
        space=scenario.space,
        run=run,
        calibrators=judges(referee, "lexicographic"),
        referee=referee,
        paper=scenario.references["paper, preferences"],
        version=3,  # 0.0873 rad/s limit the steering, no longer 0.0873 rad a step
    )


PROBLEMS = (*FUNCTIONS, "cstr", GUIDELINES, "overtake")
"""Names of the problems, in the order of the tables."""
CALIBRATORS = ("perfect", "lexicographic", *NOISES)
"""Names of all calibrators, in the order of the tables; each problem has some of them."""
