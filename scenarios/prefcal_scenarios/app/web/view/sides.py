"""Show one side of a question, and a question with both sides."""

from collections.abc import Iterable
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.app.presentation.wording import ended_text, knob_number, measured, objective
from prefcal_scenarios.app.session import Question, Side
from prefcal_scenarios.app.summary.compare import compared
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
    sides = (question.left, question.right)
    first, *others = pairs_of(scenario, *(side.experiment for side in sides))
    left, right = (
        side_view(side, other.experiment, scenario, seen, blind=blind, drawn=drawn)
        for side, other, drawn in ((*sides, first.left), (*sides[::-1], first.right))
    )
    return {
        "id": question.id,
        "number": question.number,
        "repeat": question.repeats is not None,
        "further": question.further,
        "comparison": comparison_view(question, scenario, seen),
        **_pair_view(first, seen),
        "left": left,
        "right": right,
        "others": [
            {
                **_pair_view(pair, seen),
                "left": _run_view(pair.left, scenario, seen),
                "right": _run_view(pair.right, scenario, seen),
            }
            for pair in others
        ],
    }


def comparison_view(question: Question, scenario: Scenario, seen: Seen) -> list[dict[str, Any]]:
    """Return a row for each KPI that either side has, see `compared`."""
    sides = question.left.experiment, question.right.experiment
    return compared(*sides, scenario.shown_kpis, seen.spread)


def _pair_view(pair: Pair, seen: Seen) -> dict[str, Any]:
    """Return what both sides of a maneuver share."""
    axes = seen.frame(pair.panels, pair.left, pair.right, maneuver=pair.name)
    return {
        "maneuver": pair.name,
        "panels": [panel_view(panel) for panel in pair.panels],
        "axes": axes,
        "window": eventful(pair.panels, axes, pair.left, pair.right),
        "differ": largest_difference(pair.panels, axes["y"], pair.left, pair.right),
    }


def _run_view(run: Experiment, scenario: Scenario, seen: Seen) -> dict[str, Any]:
    """Return the curves of one maneuver, its KPIs, and how it ended."""
    part = {"part": numbers_view(run, scenario)} if run.maneuver else {"part": None}
    return {**seen.drawn(run, scenario), **part, "empty": not len(run.t)}


def side_view(
    side: Side,
    other: Experiment,
    scenario: Scenario,
    seen: Seen,
    *,
    blind: bool,
    drawn: Experiment | None = None,
) -> dict[str, Any]:
    """Return one experiment with the curves of `drawn`: one of its maneuvers, or itself if None."""
    experiment = side.experiment
    return {
        **numbers_view(experiment, scenario),
        "number": None if blind else side.index + 1,
        "role": None if blind else side.role,
        "marks": sorted(side.marks),
        "counts_as_unsafe": side.counts_as_unsafe,
        "theta": [] if blind else theta_view(scenario.space, experiment, other),
        **_run_view(experiment if drawn is None else drawn, scenario, seen),
    }


def numbers_view(experiment: Experiment, scenario: Scenario) -> dict[str, Any]:
    """Return how an experiment ended, and its KPIs: those with an objective first."""
    return numbers_of(experiment, scenario.shown_kpis)


def numbers_of(experiment: Experiment, kpis: Iterable[KPI]) -> dict[str, Any]:
    """Return how an experiment ended, and those of `kpis` that it has."""
    shown = [kpi for kpi in kpis if kpi.name in experiment.kpis]
    shown.sort(key=lambda kpi: not objective(kpi))
    return {
        "ended": ended_text(experiment),
        "interrupted": experiment.end.interrupted,
        "empty": not len(experiment.t),
        "kpis": [_kpi_view(kpi, experiment) for kpi in shown],
    }


def _kpi_view(kpi: KPI, experiment: Experiment) -> dict[str, Any]:
    words = objective(kpi)
    return {
        "title": kpi.title,
        "about": kpi.about,
        "unit": kpi.unit,
        "text": measured(kpi, experiment),
        "met": kpi.met_by(experiment),
        "objective": f"{words} {kpi.unit}".strip() if words else "",
    }


def theta_view(
    space: KnobSpace, experiment: Experiment, other: Experiment | None = None
) -> list[dict[str, Any]]:
    """Return θ with units, and whether each value as shown differs from that of `other`."""
    texts = _texts(space, experiment)
    others = texts if other is None else _texts(space, other)
    return [
        {
            "name": knob.name,
            "about": knob.about,
            "unit": knob.unit,
            "text": text,
            "differs": text != its,
        }
        for knob, text, its in zip(space, texts, others, strict=True)
    ]


def _texts(space: KnobSpace, experiment: Experiment) -> list[str]:
    return [knob_number(k, float(v)) for k, v in zip(space, experiment.theta, strict=True)]
