"""Run the studies of section IV: reactor and car by preferences, and the reactor by its index."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from prefcal_agents import GLIS, GLISp
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import ask_and_tell, calibrate
from prefcal_scenarios.catalog import load

from .paper import N_INIT, N_MAX

Theta = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Case:
    """A study of the paper by GLISp, or by GLIS, which gets the index, without a calibrator."""

    name: str
    title: str
    scenario: str
    calibrator: str | None


_REACTOR, _CAR = "cstr", "overtake"
CASES = (
    Case("cstr-preferences", "Reactor, calibrated by preferences", _REACTOR, "synthetic"),
    Case("cstr-automated", "Reactor, calibrated automatically", _REACTOR, None),
    Case("overtake-preferences", "Car, calibrated by preferences", _CAR, "synthetic"),
)
"""Cases in the order of the paper."""


@dataclass(frozen=True, slots=True)
class Asked:
    """One comparison: the better θ and the worse θ."""

    better: Theta
    worse: Theta


@dataclass(frozen=True, slots=True)
class PaperStudy:
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


def tasks(seeds: Sequence[int]) -> list[Callable[[], PaperStudy]]:
    """Return one task for each case and seed; tasks can run in any process."""
    return [partial(study, case, seed) for seed in seeds for case in CASES]


def study(case: Case, seed: int) -> PaperStudy:
    """Run one study with the settings of section IV of the paper."""
    scenario = load(case.scenario)
    if case.calibrator is None:
        cost = scenario.cost
        assert cost is not None
        seeing = GLIS(scenario.space, n_init=N_INIT, n_max=N_MAX, seed=seed)
        deque(ask_and_tell(seeing, scenario.run, lambda new, _: cost(new)), maxlen=0)  # runs it
        return PaperStudy(case.name, seed, _plain(seeing.best), N_MAX, 0, ())
    agent = GLISp.paper(scenario.space, n_init=N_INIT, n_max=N_MAX, seed=seed)
    asked, comparisons = list[Asked](), 0
    for one in calibrate(agent, scenario.run, scenario.calibrators[case.calibrator](seed)):
        if one.incumbent is None:
            continue
        comparisons += 1
        pair = _plain(one.challenger.theta), _plain(one.incumbent.theta)
        if one.answer.preference is not Preference.TIE:
            new_won = one.answer.preference is Preference.CHALLENGER
            asked.append(Asked(*(pair if new_won else pair[::-1])))
    best, count = _plain(agent.best), len(agent.samples)
    return PaperStudy(case.name, seed, best, count, comparisons, tuple(asked))


def _plain(theta: np.ndarray) -> Theta:
    return tuple(map(float, theta))
