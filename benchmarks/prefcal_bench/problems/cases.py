"""Problems with a calibrator of their own: test functions, the reactor, and the overtaking."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_bench.people import VERSION, fingerprint
from prefcal_bench.problems.functions import TestFunction
from prefcal_env.calibrators import LatentCost
from prefcal_env.errors import SettingsError
from prefcal_scenarios.runs import outcome
from prefcal_scenarios.scenario import Scenario

from .problem import Outcome, Problem, judges, same

CSTR_BROAD = 0.69066
"""Smallest known eq. perf_index of a CSTR run that does not undershoot the accepted band.

Attained at θ = (0.25, 25, -1.000783). Gaps are measured from it, since it is the bottom of the
basin that answers lead to and that people would accept. Source: docs/gallery/reactor.md.
"""
CSTR_HOLE = 0.41508
"""Smallest known eq. perf_index in the whole box, at θ = (0.25, 4, -0.98486).

It lies in a crease about 0.09 wide in log Q, where C_A undershoots the target by 0.49 kgmol/m³,
which the index does not count, and ends on the target by chance.
Source: docs/gallery/reactor.md.
"""
HOLES: Mapping[str, float] = {"cstr": CSTR_BROAD - CSTR_HOLE}
"""How far below `best_known` a problem's cost can fall in a hole that gaps exclude."""

GUIDELINES = "cstr-guidelines"
"""Name of the problem of the reactor, judged by criteria in their order."""


def _cost(outcome: Any) -> float:
    """Return the cost of an outcome, which test functions use in place of an experiment."""
    if outcome.cost is None:
        raise SettingsError("outcomes without a cost cannot be compared by it")
    return float(outcome.cost)


def of_function(function: TestFunction) -> Problem:
    """Return the problem of a test function, judged by its value."""

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


def reactor() -> Problem:
    """Return the paper's reactor, judged by its index."""
    from prefcal_scenarios.cases.cstr import synthetic

    referee = synthetic()
    return Problem(
        name="cstr",
        space=_cstr().space,
        run=_run_reactor,
        calibrators=judges(referee, "perfect"),
        referee=referee,
        best_known=CSTR_BROAD,
        version=f"2, tastes {VERSION}",
        scenario=_cstr(),
    )


def guidelines() -> Problem:
    """Return the same reactor, judged by the paper's guidelines in their order.

    Answers by the guidelines do not follow the index, so it cannot score the result. As in the
    overtaking, the returned θ are compared with each other by the guidelines.
    """
    from prefcal_scenarios.cases.cstr import lexicographic

    referee = lexicographic()
    scenario = _cstr()

    def run(theta: Float[np.ndarray, " 3"]) -> Outcome:
        return replace(_run_reactor(theta), cost=None)

    return Problem(
        name=GUIDELINES,
        space=scenario.space,
        run=run,
        calibrators={"lexicographic": partial(same, referee)},
        referee=referee,
        paper=scenario.references["paper, preferences"],
        plant=scenario,
    )


def _cstr() -> Scenario:
    from prefcal_scenarios.cases.cstr import cstr  # imports solvers

    return cstr


def _run_reactor(theta: Float[np.ndarray, " 3"]) -> Outcome:
    """Run one experiment of the reactor, with its index and its KPIs."""
    scenario = _cstr()
    experiment = scenario.run(theta)
    assert scenario.cost is not None
    cost = float(scenario.cost(experiment))
    return Outcome(theta, cost, experiment, outcome(scenario, experiment))


def overtaking() -> Problem:
    """Return the paper's overtaking, judged by criteria in their order, without a cost."""
    from prefcal_scenarios.cases.overtake import calibrator
    from prefcal_scenarios.cases.overtake import overtake as scenario

    referee = calibrator()
    return Problem(
        name="overtake",
        space=scenario.space,
        run=partial(run_scenario, scenario),
        calibrators=judges(referee, "lexicographic"),
        referee=referee,
        paper=scenario.references["paper, preferences"],
        # Version 3: 0.0873 rad/s limit the steering, no longer 0.0873 rad a step.
        version=f"3, tastes {VERSION}",
        scenario=scenario,
    )


def closed_loop(name: str, scenario: Scenario) -> Problem:
    """Return the problem of a scenario that only tastes judge.

    Args:
        name: Name in tables and on the command line.
        scenario: Scenario with KPIs that have a direction.

    Raises:
        SettingsError: If no KPI has a direction.
    """
    if all(kpi.goal is None for kpi in scenario.kpis):
        raise SettingsError(f"{name} has no KPI with a direction, which tastes need")
    return Problem(
        name=name,
        space=scenario.space,
        run=partial(run_scenario, scenario),
        calibrators={},
        version=f"{fingerprint(scenario)[:16]}, tastes {VERSION}",
        scenario=scenario,
    )


def run_scenario(scenario: Scenario, theta: Float[np.ndarray, " n"]) -> Outcome:
    """Run one experiment of a scenario without a cost, with its KPIs."""
    experiment = scenario.run(theta)
    return Outcome(theta, None, experiment, outcome(scenario, experiment))
