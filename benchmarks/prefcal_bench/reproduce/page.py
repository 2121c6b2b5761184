"""Write the page of the reproduction with the paper's four figures, a single file."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from prefcal_app.report.export import versions
from prefcal_app.report.pictures import figure as side_by_side
from prefcal_app.report.write import environment
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_scenarios.cases.overtake.picture import ShownDrive, drawn
from prefcal_scenarios.style import BEST, FIRST, OTHERS, png, style
from prefcal_scenarios.wording import put

from .paper import COMPARISONS, DEVIATIONS, N_MAX, algorithm, parameters, ranges
from .studies import CaseResult, PaperStudy, compared, disagreements, found, rows

PAPER = "Zhu, Bemporad, Piga: Preference-based MPC calibration (ECC 2021)"
DOI = "10.23919/ECC54610.2021.9654900"
_FINAL = "Top: at the paper's θ, simulated here. Bottom: as calibrated here with seed 0."


@dataclass(frozen=True, slots=True)
class Pictured:
    """A figure of the paper and its reproduction."""

    label: str  # label of the figure in the paper
    statement: str  # what the paper shows and says about it
    caption: str
    content: bytes  # reproduction as PNG
    # The same figure at the paper's θ, simulated here, as PNG; None if the paper states no θ
    reference: bytes | None = None


def write_page(studies: Sequence[PaperStudy], folder: Path, command: str) -> Path:
    """Write paper.html and its figures into `folder`, and return the path of the page.

    `command` repeats the reproduction.
    """
    results = found(studies)
    shown = list(pictures(results))
    for picture in shown:
        put(folder / f"{picture.label.removeprefix('Fig. ')}.png", picture.content)
    seeds = len(results[0].studies)
    once = "once, with seed 0"
    heads = ("", "printed", "paper's θ here", "seed 0 here", f"median of {seeds}", "range")
    template = environment("prefcal_bench").get_template("reproduce/paper.html.j2")
    text = template.render(
        paper=PAPER,
        doi=DOI,
        repeated=once if seeds == 1 else f"{seeds} times, with seeds 0 to {seeds - 1}",
        n_max=N_MAX,
        comparisons=COMPARISONS,
        compared=compared(results),
        disagreements=disagreements(results),
        results=[(result.case.title, heads, rows(result)) for result in results],
        drawn=shown,
        tables=(
            ("Table CSTR_para", parameters()),
            ("Settings of the algorithm", algorithm()),
            ("Ranges of the tuned parameters", ranges()),
        ),
        deviations=[(d.paper, d.ours, d.why, d.effect) for d in DEVIATIONS],
        line=command,
        versions=versions(),
    )
    put(folder / "paper.html", text.encode())
    return folder / "paper.html"


def pictures(results: Sequence[CaseResult]) -> Iterator[Pictured]:
    """Yield the four figures of section IV, drawn from the experiments of the first seed."""
    with style():
        yield from _of_reactor(*results[:2])
        yield from _of_car(results[2])


def _of_reactor(reactor: CaseResult, automated: CaseResult) -> Iterator[Pictured]:
    scenario, clearest = reactor.scenario, _clearest(reactor, "settling_time", _settled)
    yield Pictured(
        "Fig. CSTR_query",
        "Query window of one iteration; the left experiment is preferred because its transient is faster.",
        "Among the comparisons with seed 0 between two experiments that settle, the one with the "
        "largest difference in the time to steady state.",
        png(side_by_side(scenario, *clearest, ("preferred", "not preferred"))),
    )
    labels = ("calibrated by preferences (GLISp)", "calibrated automatically (GLIS)")
    printed = ("the paper's θ, by preferences", "the paper's θ, automatically")
    yield Pictured(
        "Fig. CSTR_final_performance",
        "Calibrated by preferences (left) and by minimizing eq. perf_index (right): both achieve "
        "similar performance.",
        _FINAL,
        png(side_by_side(scenario, reactor.first, automated.first, labels)),
        png(side_by_side(scenario, reactor.paper, automated.paper, printed)),
    )


def _of_car(car: CaseResult) -> Iterator[Pictured]:
    space = car.scenario.space
    better, worse = _clearest(car, "path_peak", _in_time)
    pair = (ShownDrive(worse, "not preferred", FIRST), ShownDrive(better, "preferred", BEST))
    yield Pictured(
        "Fig. car_comparison",
        "Query window of one iteration; both controllers compute in time, and the right one is "
        "preferred because the left one moves far to the side.",
        "Among the comparisons with seed 0 between two controllers that compute in time, the "
        "one with the largest difference in how far they move to the side.",
        png(drawn(pair, space)),
    )
    calibrated = ShownDrive(car.first, "calibrated by preferences (GLISp)", BEST)
    printed = ShownDrive(car.paper, "the paper's θ", OTHERS[1])
    yield Pictured(
        "Fig. car_finalPerf",
        "Performance of the calibrated controller.",
        _FINAL,
        png(drawn((calibrated,), space)),
        png(drawn((printed,), space)),
    )


def _clearest(
    result: CaseResult, kpi: str, fit: Callable[[Experiment], bool]
) -> tuple[Experiment, Experiment]:
    """Return the preferred and the other experiment of the comparison that `kpi` explains best.

    Considers only comparisons in which both experiments are `fit` to be shown, if there are any.
    """
    asked = result.studies[0].asked
    thetas = {theta for one in asked for theta in (one.better, one.worse)}
    ran = {theta: result.scenario.run(np.array(theta)) for theta in thetas}
    pairs = [(ran[one.better], ran[one.worse]) for one in asked]
    kept = [pair for pair in pairs if all(map(fit, pair))] or pairs
    return max(kept, key=lambda pair: pair[1].kpis[kpi] - pair[0].kpis[kpi])


def _settled(experiment: Experiment) -> bool:
    return experiment.end is End.SETTLED


def _in_time(experiment: Experiment) -> bool:
    finished = not experiment.end.interrupted
    return finished and bool(experiment.kpis["t_comp_worst"] <= experiment.theta[0])
