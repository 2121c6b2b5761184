"""Tastes by name and seed: who answers, what agents are told, and the referee."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from prefcal_bench.people.flipping import Flipping
from prefcal_env.arrays import integer
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Calibrator, Preference
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.scenario import KPI, Scenario

from .draw import KINDS, alike, best_pairs
from .rule import Noticing, Rule
from .runs import Runs, runs_of
from .sample import USUAL, sample
from .trade_off import Standards, TradeOff
from .worth import random_search_worth

WRONG = {"": 0.0, "-noisy10": 0.1, "-noisy20": 0.2}
"""Share of wrong answers by the end of a taste's name."""
TASTES = tuple(f"{kind}{end}" for end in WRONG for kind in KINDS)
"""Names of all tastes."""
VERSION = 1
"""Raised when a taste answers differently."""
_WITH_COST = ("weights", "limits", "narrow", "hidden")

_TRIES = 40
_BEST = 12  # number of best runs that must not lie at the edge
_EDGE = 0.3  # distance of their mean from the middle of the unit cube beyond which they lie at the edge
_EXPERIMENTS, _REPLAYS = 50, 100
_ALIKE = 0.35  # accepted share of ties among the pairs of the best runs of people with eyes
_USUAL = (55.0, 100.0)  # accepted worth of random search after 50 experiments, 90 where any two runs differ


@dataclass(frozen=True)
class Taste:
    """One person's taste.

    Args:
        kpis: KPIs of the scenario.
        rule: Rule of the noise-free referee.
        withheld: Names of KPIs that agents are not told.
        wrong: Share of wrong answers.
        seed: Seed that decides which answers are wrong.
    """

    kpis: tuple[KPI, ...]
    rule: Rule
    withheld: tuple[str, ...] = ()
    wrong: float = 0.0
    seed: int = 0

    def calibrator(self) -> Calibrator[Experiment]:
        """Return the person at the start of a study."""
        rule = self.rule.person() if isinstance(self.rule, Standards) else self.rule
        judge = RuleCalibrator(self.kpis, rule)
        return Flipping(judge, self.wrong, self.seed) if self.wrong else judge


@dataclass(frozen=True)
class RuleCalibrator:
    """A `Calibrator` that compares two experiments by a rule."""

    kpis: tuple[KPI, ...]  # KPIs that the rule can use
    rule: Rule

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> Preference:
        """Return which one is better, as in eq. pref_fun."""
        a, b = (runs_of(self.kpis, [one]) for one in (challenger, incumbent))
        return Preference(int(self.rule.compare(a, b)[0]))


def taste(name: str, kpis: Sequence[KPI], runs: Runs, seed: int) -> Taste:
    """Return the taste called `name` of person number `seed`.

    The rule does not depend on the share of wrong answers. A rule is drawn again if by it random
    search after 50 experiments is worth less than 55 or more than 100 random experiments: then
    most runs are alike to the person (they lower the worth, but to people with eyes they raise
    it), or the answers go round in circles. It is also drawn again if people with eyes find more
    than 35 % of the pairs of the best runs alike, or if the best runs lie at the edge of the box
    in two knobs or more: such a person wants a controller that does almost nothing, or other
    ranges. After 40 draws, the one nearest to that is taken.

    Args:
        name: One of `TASTES`.
        kpis: KPIs of the scenario; those with a direction are judged.
        runs: Experiments of random θ, which show what is usual.
        seed: Number of the person, 0 or more.

    Raises:
        SettingsError: If there is no such taste or person, the scenario has no KPI with a
            direction, or there are no runs.
    """
    if name not in TASTES:
        raise SettingsError(
            f"taste must be one of {', '.join(TASTES)}, got {name!r}.{did_you_mean(name, TASTES)}"
        )
    integer("the person's number", seed, low=0)
    if not len(runs):
        raise SettingsError("a taste needs runs that show what is usual, got none")
    if not runs.names:
        raise SettingsError("a taste needs a KPI with a direction, got none")
    kind, _, noise = name.partition("-")
    rule = _usable(kind, runs, seed)
    used = tuple(term.name for term in rule.terms) if isinstance(rule, TradeOff) else ()
    withheld = used if kind == "hidden" else ()
    return Taste(tuple(kpis), rule, withheld, WRONG[f"-{noise}" if noise else ""], seed)


def calibrators_of(scenario: Scenario) -> Mapping[str, Callable[[int], Calibrator[Experiment]]]:
    """Return a calibrator for each taste, as a function of the person's number."""
    return {name: partial(_calibrator, scenario, name) for name in TASTES}


def _calibrator(scenario: Scenario, name: str, seed: int) -> Calibrator[Experiment]:
    return taste(name, scenario.kpis, sample(scenario, USUAL), seed).calibrator()


def has_cost(name: str) -> bool:
    """Return whether agents can be told the cost of the taste called `name`.

    Priorities and people with eyes have none, rising standards change it, and where answers can be
    wrong the exact value would be another problem.
    """
    return name in _WITH_COST


def _usable(kind: str, runs: Runs, seed: int) -> Rule:
    """Return the first rule drawn that fits the box and orders the runs, or the nearest to it."""
    nearest, smallest = None, np.inf
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, list(KINDS).index(kind), attempt])
        rule = KINDS[kind](runs, rng)
        faults: float = max(_at_edge(rule, runs) - 1, 0) + _blind(rule, runs)
        if not faults:
            found = random_search_worth(rule, runs, experiments=_EXPERIMENTS, replays=_REPLAYS, rng=rng)
            if _USUAL[0] <= found <= _USUAL[1]:
                return rule
            faults = max(np.log(_USUAL[0] / found), np.log(found / _USUAL[1]))
        if faults < smallest:
            nearest, smallest = rule, faults
    assert nearest is not None
    return nearest


def _blind(rule: Rule, runs: Runs) -> float:
    """Return 1 or more if too many pairs of the best runs look alike, whatever is noticed."""
    if not isinstance(rule, Noticing) or rule.ties_count:
        return 0.0
    share = alike(rule, *best_pairs(rule, runs))
    return 1.0 + share if share > _ALIKE else 0.0


def _at_edge(rule: Rule, runs: Runs) -> int:
    """Return the number of knobs in which the best runs lie at the edge; 0 if θ is unknown."""
    if not runs.z.size:
        return 0
    cost = rule.cost(runs)
    if cost is None:
        everyone = (runs.take(np.array([row])) for row in range(len(runs)))
        cost = np.array([np.count_nonzero(rule.compare(runs, one) <= 0) for one in everyone])
    best = np.argsort(cost, kind="stable")[:_BEST]
    return int(np.count_nonzero(np.abs(runs.z[best].mean(axis=0) - 0.5) > _EDGE))
