"""Draw the paper's four figures of section IV from the repeated studies."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from matplotlib.figure import Figure

from prefcal_app.report.trajectories import figure as side_by_side
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_scenarios.cases.overtake.picture import Shown, drawn
from prefcal_scenarios.presentation.style import BEST, FIRST, OTHERS, save, style

from .results import Found


@dataclass(frozen=True, slots=True)
class Pictured:
    """A figure of the paper and its reproduction.

    Args:
        label: Label of the figure in the paper.
        statement: What the paper shows and says about it.
        caption: Caption of the reproduction.
        content: Reproduction as PNG.
        reference: The same figure at the paper's θ, simulated here, as PNG; None if the paper
            states no θ.
    """

    label: str
    statement: str
    caption: str
    content: bytes
    reference: bytes | None = None


def pictures(results: Sequence[Found]) -> Iterator[Pictured]:
    """Yield the four figures, drawn from the experiments of the first seed's studies."""
    reactor, automated, car = results
    with style():
        yield _cstr_query(reactor)
        yield _cstr_final(reactor, automated)
        yield _car_query(car)
        yield _car_final(car)


def _cstr_query(result: Found) -> Pictured:
    left, right = _clearest(result, "settling_time", _settled)
    picture = side_by_side(result.scenario, left, right, ("preferred", "not preferred"))
    return Pictured(
        "Fig. CSTR_query",
        "Query window of one iteration; the left experiment is preferred because its transient is "
        "faster.",
        "Among the comparisons with seed 0 between two experiments that settle, the one with the "
        "largest difference in the time to steady state.",
        _png(picture),
    )


def _cstr_final(reactor: Found, automated: Found) -> Pictured:
    labels = ("calibrated by preferences (GLISp)", "calibrated automatically (GLIS)")
    printed = ("the paper's θ, by preferences", "the paper's θ, automatically")
    picture = side_by_side(reactor.scenario, reactor.first, automated.first, labels)
    reference = side_by_side(reactor.scenario, reactor.paper, automated.paper, printed)
    return Pictured(
        "Fig. CSTR_final_performance",
        "Calibrated by preferences (left) and by minimizing eq. perf_index (right): both achieve "
        "similar performance.",
        "Top: at the paper's θ, simulated here. Bottom: as calibrated here with seed 0.",
        _png(picture),
        _png(reference),
    )


def _car_query(result: Found) -> Pictured:
    better, worse = _clearest(result, "path_peak", _in_time)
    pair = (Shown(worse, "not preferred", FIRST), Shown(better, "preferred", BEST))
    return Pictured(
        "Fig. car_comparison",
        "Query window of one iteration; both controllers compute in time, and the right one is "
        "preferred because the left one moves far to the side.",
        "Among the comparisons with seed 0 between two controllers that compute in time, the one "
        "with the largest difference in how far they move to the side.",
        _png(drawn(pair, result.scenario.space)),
    )


def _car_final(result: Found) -> Pictured:
    shown = Shown(result.first, "calibrated by preferences (GLISp)", BEST)
    printed = Shown(result.paper, "the paper's θ", OTHERS[1])
    space = result.scenario.space
    return Pictured(
        "Fig. car_finalPerf",
        "Performance of the calibrated controller.",
        "Top: at the paper's θ, simulated here. Bottom: as calibrated here with seed 0.",
        _png(drawn((shown,), space)),
        _png(drawn((printed,), space)),
    )


def _clearest(
    result: Found, kpi: str, fit: Callable[[Experiment], bool]
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


def _png(picture: Figure) -> bytes:
    buffer = BytesIO()
    save(picture, buffer)
    return buffer.getvalue()
