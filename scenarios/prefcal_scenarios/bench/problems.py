"""What the agents are tried on: test functions, the reactor, the overtaking."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios.functions import FUNCTIONS, TestFunction

from .judges import ByCost, ByCriteria, Flipping, Judge, Outcome

CSTR_BEST = 0.69066
"""Smallest eq. perf_index known in the box of the CSTR, at θ = (0.25, 25, -1.000783).

Source: `benchmarks/best_known.py`, some 4,600 experiments a seed; three ended within 2e-6 of it.
"""

NOISES: Mapping[str, float] = {"noisy10": 0.1, "noisy20": 0.2}
"""Share of the answers that are flipped, by the name of the calibrator."""

JudgeFactory = Callable[[int], Judge]


@dataclass(frozen=True)
class Problem:
    """A problem of the benchmark.

    Args:
        name: In tables and on the command line.
        space: The knobs.
        run: What comes of a θ, physical, shape (n,), inside the box.
        calibrators: Who compares, by name; each is made from a seed.
        referee: The one who decides between results: never wrong, the same for every calibrator.
        best_known: Smallest cost known; None where there is no cost.
        paper: The paper's optimum, physical, shape (n,), to compare with where there is no cost.
        version: Raised when the same θ has another outcome, or calibrators answer differently.
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
        """Whether experiments have a cost that value-based agents can be told."""
        return self.best_known is not None

    def outcome(self, theta: Float[np.ndarray, " n"]) -> Outcome:
        """Try θ, physical, shape (n,).

        Raises:
            KnobError: θ does not fit the space.
        """
        return self.run(self.space.check(theta))

    def gap(self, outcome: Outcome) -> float:
        """How far the cost lies above the best known one, free of noise.

        Raises:
            SettingsError: the problem has no cost.
        """
        if self.best_known is None or outcome.cost is None:
            raise SettingsError(f"problem {self.name!r} has no cost, and so no gap")
        return outcome.cost - self.best_known


@cache
def problem(name: str) -> Problem:
    """The problem called `name`, one of `PROBLEMS`.

    Raises:
        SettingsError: there is none.
    """
    if name not in PROBLEMS:
        raise SettingsError(f"problem must be one of {', '.join(PROBLEMS)}, got {name!r}")
    if name in FUNCTIONS:
        return _of_function(FUNCTIONS[name])
    return _reactor() if name == "cstr" else _overtaking()


def judges(referee: Judge, name: str) -> dict[str, JudgeFactory]:
    """The `referee` under `name`, and those who err now and then."""
    noisy = {noise: partial(Flipping, referee, share) for noise, share in NOISES.items()}
    return {name: partial(_sure, referee), **noisy}


def _sure(judge: Judge, seed: int) -> Judge:
    """The same judge, whatever the seed."""
    return judge


def _of_function(function: TestFunction) -> Problem:
    def run(theta: Float[np.ndarray, " n"]) -> Outcome:
        return Outcome(theta, function(theta))

    return Problem(
        name=function.name,
        space=function.space,
        run=run,
        calibrators=judges(ByCost(), "perfect"),
        referee=ByCost(),
        best_known=function.optimum,
    )


def _reactor() -> Problem:
    """The paper's reactor. Who follows its guidelines (lexicographic) does not see the index.

    So the gap of that calibrator says how good the index becomes that he never judged by.
    """
    from prefcal_scenarios.cstr import cstr as scenario  # loads solvers
    from prefcal_scenarios.cstr.room import lexicographic
    from prefcal_scenarios.outcomes import outcome

    cost = scenario.cost
    assert cost is not None

    def run(theta: Float[np.ndarray, " 3"]) -> Outcome:
        experiment = scenario.run(theta)
        return Outcome(theta, float(cost(experiment)), experiment, outcome(scenario, experiment))

    return Problem(
        name="cstr",
        space=scenario.space,
        run=run,
        calibrators=judges(ByCost(), "perfect")
        | {"lexicographic": partial(_sure, ByCriteria(lexicographic()))},
        referee=ByCost(),
        best_known=CSTR_BEST,
        version=2,
    )


def _overtaking() -> Problem:
    """The paper's overtaking: criteria in their order, and no cost."""
    from prefcal_scenarios.outcomes import outcome
    from prefcal_scenarios.overtake import overtake as scenario
    from prefcal_scenarios.overtake.criteria import synthetic

    def run(theta: Float[np.ndarray, " 5"]) -> Outcome:
        experiment = scenario.run(theta)
        return Outcome(theta, None, experiment, outcome(scenario, experiment))

    referee = ByCriteria(synthetic())
    return Problem(
        name="overtake",
        space=scenario.space,
        run=run,
        calibrators=judges(referee, "lexicographic"),
        referee=referee,
        paper=scenario.references["paper, preferences"],
        version=2,
    )


PROBLEMS = (*FUNCTIONS, "cstr", "overtake")
"""Names of the problems, in the order of the tables."""
CALIBRATORS = ("perfect", "lexicographic", *NOISES)
"""Names of all calibrators, in the order of the tables; a problem has some of them."""
