"""What an agent can learn about an experiment besides θ: the scenario's KPIs and generic ones."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import End, Experiment, returned
from prefcal_env.experiments.maneuvers import MEAN, by_maneuver, named
from prefcal_env.experiments.tracking import tracking_kpis
from prefcal_env.preferences.kpis import Outcome
from prefcal_env.preferences.reading import Reading

from .catalog import load
from .scenario import KPI, Scenario

INTERRUPTED = "interrupted"
"""Name of the KPI that is 1 for a run that was stopped or failed, and 0 otherwise."""


WORST = "worst"
"""Group of the KPIs that are the worst of all maneuvers."""


class Result(Protocol):
    """What remains of any run: an `Experiment`, or what `simulate_many` returns for it."""

    @property
    def end(self) -> End:
        """Why the run ended."""

    @property
    def kpis(self) -> Mapping[str, float]:
        """KPIs by name, in the units of the scenario."""


def outcome(scenario: Scenario, experiment: Experiment) -> Outcome:
    """Return the KPIs of `experiment` by name, lower is better; infinite is the worst value.

    They are the scenario's KPIs with a known direction of improvement. Only if no KPI has a
    direction, generic ones of the trajectory take their place. All are infinite for a run that was
    stopped: a short run would otherwise look good, since it accumulates little error. Those of one
    that was cut short since it could no longer win are unknown.
    """
    if experiment.end is End.CUT_SHORT:
        return Outcome({})
    [known] = _known(scenario, [experiment])
    return Outcome({**known, INTERRUPTED: float(experiment.end.interrupted)})


def has_goals(scenario: Scenario) -> bool:
    """Return whether some KPI of the scenario has a direction of improvement."""
    return any(kpi.goal is not None for kpi in scenario.kpis)


def screened(scenario: Scenario, experiment: Result) -> Outcome:
    """Return the KPIs by which simulated experiments are screened, those of `outcome`.

    That all are infinite for a run that was stopped keeps agents away from its θ; a run that failed
    has no KPIs at all.

    Args:
        scenario: Scenario of the experiment.
        experiment: Experiment, or what `simulate_many` returns for it.

    Raises:
        ScenarioError: If the scenario has no KPI with a direction, and the trajectory is not kept.
    """
    return all_screened(scenario, [experiment])[0]


def all_screened(scenario: Scenario, experiments: Sequence[Result]) -> list[Outcome]:
    """Return what `screened` returns for each of many experiments, in order."""
    found = [Outcome({})] * len(experiments)
    rows = [k for k, each in enumerate(experiments) if each.end is not End.FAILED or each.kpis]
    for row, known in zip(rows, _known(scenario, [experiments[k] for k in rows]), strict=True):
        found[row] = Outcome(known)
    return found


def reading(scenario: Scenario) -> Reading:
    """Return how people read the KPIs that `outcome` and `screened` return."""
    kpis = [kpi for kpi in scenario.kpis if kpi.goal is not None]
    ends = {k.name: k.at_least if k.goal == "higher" else k.at_most for k in kpis}
    return Reading(
        {k.name: k.step for k in kpis},
        {k.name: float(k.badness(ends[k.name])) for k in kpis if np.isfinite(ends[k.name])},
        frozenset(k.name for k in kpis if k.goal == "target"),
    )


def simulator(scenario: Scenario | str, *, seed: int = 0) -> Callable[[Float[np.ndarray, " n"]], Outcome]:
    """Return a function of a physical θ, shape (n,), that runs it here and returns its KPIs.

    It is the `simulate` of `Screening` and `minimize_by_preference`; its KPIs are `screened`.

    Args:
        scenario: Scenario, or its name as for `load`.
        seed: Seed of every run.

    Raises:
        ScenarioError: If there is no such scenario.
    """
    found = load(scenario) if isinstance(scenario, str) else scenario

    def simulate(theta: Float[np.ndarray, " n"]) -> Outcome:
        return screened(found, returned(found.run(theta, seed=seed)))

    simulate.reading = reading(found)  # type: ignore[attr-defined]
    return simulate


def _known(scenario: Scenario, experiments: Sequence[Result]) -> list[dict[str, float]]:
    """Return the KPIs that agents learn from, of each experiment; all infinite if it was stopped."""
    if not has_goals(scenario):
        return [_tracked(scenario, experiment) for experiment in experiments]
    kpis = [kpi for kpi in scenario.kpis if kpi.goal is not None]
    # One table, a column for each KPI: NaN is what a run did not measure, which an `Outcome` drops.
    values = [[each.kpis.get(kpi.name, np.nan) for kpi in kpis] for each in experiments]
    table = np.array(values, dtype=float).reshape(len(experiments), len(kpis))
    known = np.stack([kpi.badness(column) for kpi, column in zip(kpis, table.T, strict=True)], axis=1)
    known[[each.end.interrupted for each in experiments]] = np.inf
    return [dict(zip([kpi.name for kpi in kpis], row, strict=True)) for row in known.tolist()]


def _tracked(scenario: Scenario, experiment: Result) -> dict[str, float]:
    """Return the generic KPIs of an experiment, the worst of all its maneuvers."""
    if not isinstance(experiment, Experiment):
        raise ScenarioError(
            f"scenario {scenario.name!r} has no KPI with a direction, so its trajectories are "
            "needed: simulate_many(..., trajectories=True)"
        )
    worst: dict[str, float] = {}
    for run in by_maneuver(experiment).values():
        for name, value in tracking_kpis(run).items() if len(run.t) else ():
            worst[name] = max(worst.get(name, value), value)
    return dict.fromkeys(worst, np.inf) if experiment.end.interrupted else worst


def grouped(kpis: Sequence[KPI], *experiments: Experiment) -> list[tuple[str, KPI]]:
    """Return the KPIs that some of the experiments have, each with the group that it belongs to.

    Without maneuvers there is one group, "". With maneuvers the groups are "worst" (the KPIs that
    agents learn from), "mean", whose KPIs have no objective, and the name of each maneuver.
    """
    parts = {part: None for e in experiments for part in by_maneuver(e) if part}
    if not parts:
        rows = [("", kpi) for kpi in kpis]
    else:
        rows = [(WORST, kpi) for kpi in kpis]
        rows += [(MEAN, _without_objective(kpi)) for kpi in kpis]
        rows += [(part, replace(k, name=named(k.name, part))) for part in parts for k in kpis]
    return [(part, kpi) for part, kpi in rows if any(kpi.name in e.kpis for e in experiments)]


def _without_objective(kpi: KPI) -> KPI:
    """Return the mean of a KPI; limits apply to each maneuver, not to their mean."""
    better = None if kpi.goal == "target" else kpi.goal
    name = named(kpi.name, MEAN)
    return replace(kpi, name=name, at_most=np.inf, at_least=-np.inf, better=better)
