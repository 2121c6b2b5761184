"""Run the studies of section IV, and compare what they find: as printed, simulated, and calibrated.

Reactor and car are calibrated by preferences, and the reactor by its index, too.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from prefcal_agents import GLIS, GLISp
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Preference, ask_and_tell, calibrate
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.wording import labeled, measured, number

from .paper import COMPARISONS, N_INIT, N_MAX, T_COMP, THETA

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
SHOWN = {
    "cstr": ("index", "settling_time", "final_concentration", "mean_square_move", "undershoot"),
    "overtake": ("t_comp_worst", "lateral_distance", "path_peak", "lateral_acceleration", "speed_error"),
}
"""KPIs in the tables, by scenario."""

Row = tuple[str, str, str, str, str, str]
"""Name, and values: printed, at the paper's θ here, of the first study, median and range of all."""


@dataclass(frozen=True, slots=True)
class Asked:
    """One comparison: the better θ and the worse θ."""

    better: Theta
    worse: Theta


@dataclass(frozen=True, slots=True)
class PaperStudy:
    """Results of one study."""

    case: str  # name of the case, as in `CASES`
    seed: int  # seed of the agent
    best: Theta  # calibrated θ, physical
    experiments: int
    comparisons: int
    asked: tuple[Asked, ...]  # comparisons with a winner, in order; empty without a calibrator


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


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Results of one case: the experiments at the paper's θ and at the θ of each study."""

    case: Case
    scenario: Scenario
    paper: Experiment
    studies: tuple[PaperStudy, ...]
    experiments: tuple[Experiment, ...]

    @property
    def first(self) -> Experiment:
        """Return the experiment at the calibrated θ of the first study."""
        return self.experiments[0]


def found(studies: Sequence[PaperStudy]) -> list[CaseResult]:
    """Run the experiments of the tables: at the paper's θ, and at the best θ of each study."""
    results = []
    for case in CASES:
        scenario = load(case.scenario)
        own = tuple(s for s in studies if s.case == case.name)
        at_best = tuple(scenario.run(np.array(s.best)) for s in own)
        paper = scenario.run(np.array(THETA[case.name]))
        results.append(CaseResult(case, scenario, paper, own, at_best))
    return results


def rows(result: CaseResult) -> list[Row]:
    """Return the rows of the table of one case: its knobs, then its KPIs."""
    table: list[Row] = []
    for k, knob in enumerate(result.scenario.space):
        printed = number(THETA[result.case.name][k])
        values = [float(e.theta[k]) for e in result.experiments]
        name = labeled(knob.name, knob.unit)
        table.append((name, printed, printed, number(values[0]), *_spread(values)))
    kpis = {kpi.name: kpi for kpi in result.scenario.kpis}
    for name in SHOWN[result.scenario.name]:
        printed = number(T_COMP) if name == "t_comp_worst" else "–"
        values = [float(e.kpis[name]) for e in result.experiments]
        here, ours = (measured(kpis[name], one) for one in (result.paper, result.first))
        title = labeled(kpis[name].title, kpis[name].unit)
        table.append((title, printed, here, ours, *_spread(values)))
    return table


def _spread(values: Sequence[float]) -> tuple[str, str]:
    """Return the median, and the smallest and largest values, as text."""
    return number(float(np.median(values))), f"{number(min(values))} … {number(max(values))}"


def compared(results: Sequence[CaseResult]) -> list[str]:
    """Return what each case puts beside what, and what comes out, as one sentence or more each."""
    reactor, automated, car = results
    n = len(car.experiments)
    controllers = "one calibrated controller" if n == 1 else f"{n} calibrated controllers"
    in_time = sum(e.kpis["t_comp_worst"] <= e.theta[0] for e in car.experiments)
    apart = sum(
        e.kpis["lateral_distance"] >= car.paper.kpis["lateral_distance"] - 0.05 for e in car.experiments
    )
    return [
        "Reactor, by preferences: each answer goes by the performance index, so what is tested is "
        "whether comparisons alone find its minimum, and not what a person wants. Index of "
        f"{_studies(n)}: median {number(_index(reactor))}; at the paper's θ, simulated here, "
        f"{number(reactor.paper.kpis['index'])}.",
        "Reactor, automated: GLIS is told the same index. Median "
        f"{number(_index(automated))}; at the paper's θ {number(automated.paper.kpis['index'])}.",
        f"Car: a synthetic person answers by criteria (i) to (vi). Of {controllers}, {in_time} "
        f"{'computes' if in_time == 1 else 'compute'} every step within T_s, and {apart} "
        f"{'passes' if apart == 1 else 'pass'} the obstacle at no less than the distance that the "
        "paper's θ keeps here, less 5 cm.",
        "The paper prints θ and the car's computation time, but no other value of a KPI. All "
        "others in its columns are simulated here.",
    ]


def disagreements(results: Sequence[CaseResult]) -> list[str]:
    """Return where our results contradict the paper's, or cannot confirm them."""
    reactor, automated, car = results
    ours = abs(_index(reactor) - _index(automated))
    printed = [float(r.paper.kpis["index"]) for r in (reactor, automated)]
    found = [
        "The paper finds that calibration by preferences and by the index achieve similar "
        f"performance. At its own two θ the index here is {number(printed[0])} and "
        f"{number(printed[1])}: by preferences "
        f"{100 * (printed[0] / printed[1] - 1):.0f} % more. Our medians differ by {ours:.4f}, "
        "which proves nothing about people: our answers go by the index itself."
    ]
    judged = [_prefers_paper(car, k) for k in range(len(car.studies))]
    if any(judged):
        first = "with seed 0 too, which is drawn below" if judged[0] else "with seed 0 not"
        peaks = [number(float(e.kpis["path_peak"])) for e in (car.paper, car.first)]
        found.append(
            f"The car's synthetic person prefers the paper's θ to what was found in {sum(judged)} "
            f"of {_studies(len(judged))} ({first}). Farthest to the side: {peaks[0]} m at "
            f"the paper's θ, {peaks[1]} m with seed 0."
        )
    for result in results:
        if (asked := result.studies[0].comparisons) not in (0, COMPARISONS):
            found.append(f"{result.case.scenario}: {asked} comparisons here, {COMPARISONS} there.")
    return found


def _prefers_paper(car: CaseResult, index: int) -> bool:
    """Return whether the synthetic person of a study prefers the paper's θ to the calibrated."""
    assert car.case.calibrator is not None
    person = car.scenario.calibrators[car.case.calibrator](car.studies[index].seed)
    verdict = Answer.of(person.prefer(car.paper, car.experiments[index])).preference
    return verdict is Preference.CHALLENGER


def _index(result: CaseResult) -> float:
    return float(np.median([e.kpis["index"] for e in result.experiments]))


def _studies(count: int) -> str:
    return "one study" if count == 1 else f"{count} studies"
