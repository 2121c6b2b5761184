"""Show one side of a question, and a question with both sides."""

from collections.abc import Iterable, Sequence
from typing import Any

from prefcal_app.session import Question, Side
from prefcal_app.summary.compare import compared, words_of
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Plot
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.presentation.wording import ended_text, knob_number, measured, objective
from prefcal_scenarios.scenario import KPI, Scenario

from .maneuvers import Pair, eventful, largest_difference, pairs_of
from .panels import panel_view
from .seen import Seen


def question_view(
    question: Question, scenario: Scenario, *, blind: bool, seen: Seen | None = None
) -> dict[str, Any]:
    """Return a question; with `blind`, numbers, roles and θ are not sent.

    Axes and large differences are based on all experiments `seen` so far.
    """
    seen = Seen() if seen is None else seen
    left, right = question.left, question.right
    pairs = pairs_of(scenario, left.experiment, right.experiment)
    first, *others = (pair_view(pair, scenario.shown_kpis, seen) for pair in pairs)
    return {
        "id": question.id,
        "number": question.number,
        "repeat": question.repeats is not None,
        "further": question.further,
        "comparison": comparison_view(question, scenario, seen),
        **first,
        "left": {**side_view(left, right.experiment, scenario, blind=blind), **first["left"]},
        "right": {**side_view(right, left.experiment, scenario, blind=blind), **first["right"]},
        "others": others,
    }


def comparison_view(question: Question, scenario: Scenario, seen: Seen) -> list[dict[str, Any]]:
    """Return a row for each KPI that either side has, see `compared`."""
    sides = question.left.experiment, question.right.experiment
    return compared(*sides, scenario.shown_kpis, seen.spread)


def pair_view(pair: Pair, kpis: Sequence[KPI], seen: Seen) -> dict[str, Any]:
    """Return one maneuver of two experiments: its panels and axes, and the curves of both."""
    axes = seen.frame(pair.panels, pair.left, pair.right, maneuver=pair.name)
    return {
        "maneuver": pair.name,
        "panels": [panel_view(panel) for panel in pair.panels],
        "axes": axes,
        "window": eventful(pair.panels, axes, pair.left, pair.right),
        "differ": largest_difference(pair.panels, axes["y"], pair.left, pair.right),
        "left": run_view(pair.left, pair.panels, kpis, seen),
        "right": run_view(pair.right, pair.panels, kpis, seen),
    }


def run_view(run: Experiment, panels: Sequence[Plot], kpis: Sequence[KPI], seen: Seen) -> dict[str, Any]:
    """Return the curves of a run; of a maneuver its KPIs, too, and how it ended."""
    part = numbers_view(run, kpis) if run.maneuver else None
    return {**seen.drawn(run, panels), "part": part, "empty": not len(run.t)}


def side_view(side: Side, other: Experiment, scenario: Scenario, *, blind: bool) -> dict[str, Any]:
    """Return one experiment of two, without its curves."""
    experiment = side.experiment
    return {
        **numbers_view(experiment, scenario.shown_kpis),
        "number": None if blind else side.index + 1,
        "role": None if blind else side.role,
        "marks": sorted(side.marks),
        "counts_as_unsafe": side.counts_as_unsafe,
        "theta": [] if blind else theta_view(scenario.space, experiment, other),
    }


def numbers_view(experiment: Experiment, kpis: Sequence[KPI]) -> dict[str, Any]:
    """Return how an experiment ended, and those of `kpis` that it has, limited ones first."""
    shown = [kpi for kpi in kpis if kpi.name in experiment.kpis]
    shown.sort(key=lambda kpi: not objective(kpi))
    return {
        "ended": ended_text(experiment),
        "interrupted": experiment.end.interrupted,
        "empty": not len(experiment.t),
        "kpis": [
            {**words_of(kpi), "text": measured(kpi, experiment), "met": kpi.met_by(experiment)}
            for kpi in shown
        ],
    }


def theta_view(
    space: KnobSpace, experiment: Experiment, other: Experiment | None = None
) -> list[dict[str, Any]]:
    """Return θ with units, and whether each value as shown differs from that of `other`."""
    texts = theta_texts(space, experiment.theta)
    others = texts if other is None else theta_texts(space, other.theta)
    return [
        {"name": k.name, "about": k.about, "unit": k.unit, "text": text, "differs": text != its}
        for k, text, its in zip(space, texts, others, strict=True)
    ]


def theta_texts(space: KnobSpace, theta: Iterable[float]) -> list[str]:
    """Return the values of θ as people read them, without units."""
    return [knob_number(k, float(v)) for k, v in zip(space, theta, strict=True)]
