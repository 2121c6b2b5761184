"""Compare results at the calibrated θ: as printed, simulated here, and calibrated here."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.app.presentation.wording import labeled, measured, number
from prefcal_scenarios.scenario import KPI, Scenario, load

from .printed import T_COMP, THETA
from .studies import CASES, Case, Study

SHOWN = {
    "cstr": ("index", "settling_time", "final_concentration", "mean_square_move", "undershoot"),
    "overtake": (
        "t_comp_worst", "lateral_distance", "path_peak", "lateral_acceleration", "speed_error",
    ),
}  # fmt: skip
"""KPIs in the tables, by scenario."""

Row = tuple[str, str, str, str, str, str]
"""Name, and values: printed, at the paper's θ here, of the first study, median and range of all."""


@dataclass(frozen=True, slots=True)
class Found:
    """Results of one case: the experiments at the paper's θ and at the θ of each study."""

    case: Case
    scenario: Scenario
    paper: Experiment
    studies: tuple[Study, ...]
    experiments: tuple[Experiment, ...]

    @property
    def first(self) -> Experiment:
        """Return the experiment at the calibrated θ of the first study."""
        return self.experiments[0]


def found(studies: Sequence[Study]) -> list[Found]:
    """Run the experiments of the tables: at the paper's θ, and at the best θ of each study."""
    results = []
    for case in CASES:
        scenario = load(case.scenario)
        own = tuple(s for s in studies if s.case == case.name)
        at_best = tuple(scenario.run(np.array(s.best)) for s in own)
        paper = scenario.run(np.array(THETA[case.name]))
        results.append(Found(case, scenario, paper, own, at_best))
    return results


def rows(result: Found) -> list[Row]:
    """Return the rows of the table of one case: its knobs, then its KPIs."""
    table: list[Row] = []
    for k, knob in enumerate(result.scenario.space):
        printed = number(THETA[result.case.name][k])
        values = [float(e.theta[k]) for e in result.experiments]
        name = labeled(knob.name, knob.unit)
        table.append((name, printed, printed, number(values[0]), *_spread(values)))
    for name in SHOWN[result.scenario.name]:
        table.append(_kpi_row(result, _kpi(result.scenario, name)))
    return table


def _kpi_row(result: Found, kpi: KPI) -> Row:
    printed = number(T_COMP) if kpi.name == "t_comp_worst" else "–"
    values = [float(e.kpis[kpi.name]) for e in result.experiments]
    here, ours = measured(kpi, result.paper), measured(kpi, result.first)
    return labeled(kpi.title, kpi.unit), printed, here, ours, *_spread(values)


def _kpi(scenario: Scenario, name: str) -> KPI:
    return next(kpi for kpi in scenario.kpis if kpi.name == name)


def _spread(values: Sequence[float]) -> tuple[str, str]:
    """Return the median, and the smallest and largest values, as text."""
    return number(float(np.median(values))), f"{number(min(values))} … {number(max(values))}"


def summary(results: Sequence[Found]) -> list[str]:
    """Return the findings as sentences, one for each verifiable claim of section IV."""
    reactor, automated, car = results
    index = [float(np.median([e.kpis["index"] for e in r.experiments])) for r in results[:2]]
    at_paper = [float(r.paper.kpis["index"]) for r in (reactor, automated)]
    in_time = sum(e.kpis["t_comp_worst"] <= e.theta[0] for e in car.experiments)
    apart = sum(e.kpis["lateral_distance"] >= car.paper.kpis["lateral_distance"] - 0.05
                for e in car.experiments)  # fmt: skip
    n = len(car.experiments)
    return [
        f"Reactor, by preferences: the median performance index of {_studies(n)} is "
        f"{number(index[0])}; at the paper's θ it is {number(at_paper[0])}.",
        f"Reactor, automated with GLIS: the median is {number(index[1])}; at the paper's θ it is "
        f"{number(at_paper[1])}. The paper's finding that both approaches achieve similar "
        f"performance is {'confirmed' if abs(index[0] - index[1]) < 0.02 else 'not confirmed'}: "
        f"the medians differ by {number(abs(index[0] - index[1]))}.",
        f"Car: of {n} calibrated controllers, {in_time} compute every step within T_s, and {apart} "
        "pass the obstacle at no less than the distance that the paper's θ keeps here, less 5 cm.",
    ]


def _studies(count: int) -> str:
    return "one study" if count == 1 else f"{count} studies"
