"""Run the studies of section IV: reactor and car by preferences, and the reactor by its index."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from prefcal_agents import GLIS, GLISp
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import Comparison, ask_and_tell, calibrate
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import Scenario

from .printed import N_INIT, N_MAX

Theta = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Case:
    """A study of the paper; without a calibrator, the agent gets the performance index."""

    name: str
    scenario: str
    agent: str
    calibrator: str | None


CASES = (
    Case("cstr-preferences", "cstr", "GLISp", "synthetic"),
    Case("cstr-automated", "cstr", "GLIS", None),
    Case("overtake-preferences", "overtake", "GLISp", "synthetic"),
)
"""Cases in the order of the paper."""


@dataclass(frozen=True, slots=True)
class Asked:
    """One comparison: the better θ, the worse θ, and which of them was the new one."""

    better: Theta
    worse: Theta
    new_won: bool


@dataclass(frozen=True, slots=True)
class Study:
    """Results of one study.

    Args:
        case: Name of the case, as in `CASES`.
        seed: Seed of the agent.
        best: Calibrated θ, physical.
        experiments: Number of experiments.
        comparisons: Number of comparisons.
        asked: Comparisons with a winner, in order; empty without a calibrator.
    """

    case: str
    seed: int
    best: Theta
    experiments: int
    comparisons: int
    asked: tuple[Asked, ...]


def tasks(seeds: Sequence[int]) -> list[Callable[[], Study]]:
    """Return one task for each case and seed; tasks can run in any process."""
    return [partial(study, case, seed) for seed in seeds for case in CASES]


def study(case: Case, seed: int) -> Study:
    """Run one study with the settings of section IV of the paper."""
    scenario = load(case.scenario)
    if case.calibrator is None:
        return _automated(case, scenario, seed)
    agent = GLISp.paper(scenario.space, n_init=N_INIT, n_max=N_MAX, seed=seed)
    calibrator = scenario.calibrators[case.calibrator](seed)
    asked = list(calibrate(agent, scenario.run, calibrator))
    compared = [c for c in asked if c.incumbent is not None]
    decided = tuple(_asked(c) for c in compared if c.answer.preference is not Preference.TIE)
    return Study(
        case.name, seed, _plain(agent.best), len(agent.samples), len(compared), decided
    )  # fmt: skip


def _automated(case: Case, scenario: Scenario, seed: int) -> Study:
    """Run GLIS with the performance index of every experiment as the score."""
    assert scenario.cost is not None
    agent = GLIS(scenario.space, n_init=N_INIT, n_max=N_MAX, seed=seed)
    cost = scenario.cost
    deque(ask_and_tell(agent, scenario.run, lambda new, _: cost(new)), maxlen=0)  # runs it
    return Study(case.name, seed, _plain(agent.best), N_MAX, 0, ())


def _asked(comparison: Comparison) -> Asked:
    assert comparison.incumbent is not None
    pair = _plain(comparison.challenger.theta), _plain(comparison.incumbent.theta)
    new_won = comparison.answer.preference is Preference.CHALLENGER
    better, worse = pair if new_won else pair[::-1]
    return Asked(better, worse, new_won)


def _plain(theta: np.ndarray) -> Theta:
    return tuple(map(float, theta))
