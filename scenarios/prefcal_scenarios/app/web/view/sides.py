"""Show one side of a question, and a question with both sides."""

from collections.abc import Iterable
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.app.presentation.wording import knob_number, measured
from prefcal_scenarios.app.report.tables import objective
from prefcal_scenarios.app.session import Question, Side
from prefcal_scenarios.scenario import KPI, Scenario, panels_of

from .compare import comparison_view
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
    panels = panels_of(scenario, *(side.experiment for side in sides))
    both = tuple(s.experiment for s in sides)
    left, right = (
        side_view(side, other.experiment, scenario, seen, blind=blind)
        for side, other in (sides, sides[::-1])
    )
    return {
        "id": question.id,
        "number": question.number,
        "repeat": question.repeats is not None,
        "further": question.further,
        "panels": [panel_view(panel) for panel in panels],
        "axes": seen.frame(panels, *both),
        "comparison": comparison_view(question, scenario, seen),
        "left": left,
        "right": right,
        "has_scene": scenario.scene is not None,
    }


def side_view(
    side: Side, other: Experiment, scenario: Scenario, seen: Seen, *, blind: bool
) -> dict[str, Any]:
    """Return one experiment with its curves."""
    experiment = side.experiment
    return {
        **numbers_view(experiment, scenario),
        "number": None if blind else side.index + 1,
        "role": None if blind else side.role,
        "marks": sorted(side.marks),
        "counts_as_unsafe": side.counts_as_unsafe,
        "theta": [] if blind else theta_view(scenario.space, experiment, other),
        **seen.drawn(experiment, scenario),
    }


def numbers_view(experiment: Experiment, scenario: Scenario) -> dict[str, Any]:
    """Return how an experiment ended, and its KPIs: those with an objective first."""
    return numbers_of(experiment, scenario.shown_kpis)


def numbers_of(experiment: Experiment, kpis: Iterable[KPI]) -> dict[str, Any]:
    """Return how an experiment ended, and those of `kpis` that it has."""
    shown = [kpi for kpi in kpis if kpi.name in experiment.kpis]
    shown.sort(key=lambda kpi: not objective(kpi))
    return {
        "ended": experiment.end.value,
        "interrupted": experiment.end.interrupted,
        "empty": not len(experiment.t),
        "kpis": [_kpi_view(kpi, experiment) for kpi in shown],
    }


def _kpi_view(kpi: KPI, experiment: Experiment) -> dict[str, Any]:
    met, words = kpi.met(experiment.kpis[kpi.name]), objective(kpi)
    return {
        "title": kpi.title,
        "about": kpi.about,
        "unit": kpi.unit,
        "text": measured(kpi, experiment),
        "met": None if met is None else bool(met),
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
