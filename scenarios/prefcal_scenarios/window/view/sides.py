"""One side of a question, and the question of two."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from prefcal_env.experiment import Experiment
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios.interview import Question, Side
from prefcal_scenarios.report.tables import objective
from prefcal_scenarios.report.wording import measured, number
from prefcal_scenarios.scenario import KPI, Panel, Scenario, panels_of

from .panels import curves, panel_view, reference, story


def question_view(question: Question, scenario: Scenario, *, blind: bool) -> dict[str, Any]:
    """A question; `blind` keeps numbers, roles and θ on this side of the wire."""
    sides = (question.left, question.right)
    channels = next(
        (s.experiment.channels for s in sides if len(s.experiment.t)),
        question.left.experiment.channels,
    )
    panels = panels_of(scenario, channels)
    differing = question.left.experiment.theta != question.right.experiment.theta
    left, right = (side_view(side, scenario, panels, differing, blind=blind) for side in sides)
    if question.further and not blind:
        earlier, later = (left, right) if question.incumbent is question.left else (right, left)
        earlier["role"], later["role"] = "earlier", "later"
    return {
        "id": question.id,
        "number": question.number,
        "repeat": question.repeats is not None,
        "further": question.further,
        "panels": [panel_view(panel) for panel in panels],
        "left": left,
        "right": right,
        "has_scene": scenario.scene is not None,
    }


def side_view(
    side: Side, scenario: Scenario, panels: Sequence[Panel], differing: Any, *, blind: bool
) -> dict[str, Any]:
    """One experiment with its curves."""
    experiment = side.experiment
    empty = not len(experiment.t)
    first = experiment.runs[0] if experiment.runs else experiment
    return {
        **numbers_view(experiment, scenario),
        "number": None if blind else side.index + 1,
        "role": None if blind else ("new" if side.challenger else "best so far"),
        "marks": sorted(side.marks),
        "counts_as_unsafe": side.counts_as_unsafe,
        "theta": [] if blind else theta_view(scenario.space, experiment, differing),
        "runs": max(len(experiment.runs), 1),
        "curves": [curves(p, experiment) for p in panels] if not empty else [[] for _ in panels],
        "references": [reference(p, first) for p in panels],
        "stories": [story(p, first) for p in panels],
        "scene": None if scenario.scene is None or empty else scenario.scene(first),
    }


def numbers_view(experiment: Experiment, scenario: Scenario) -> dict[str, Any]:
    """How an experiment ended, and its KPIs: first those with an objective."""
    shown = [kpi for kpi in scenario.kpis if kpi.name in experiment.kpis]
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
        "unit": kpi.unit,
        "text": measured(kpi, experiment),
        "met": None if met is None else bool(met),
        "objective": f"{words} {kpi.unit}".strip() if words else "",
    }


def theta_view(space: KnobSpace, experiment: Experiment, differing: Any) -> list[dict[str, Any]]:
    """θ in words and units; `differing` says of each knob whether the other side's differs."""
    return [
        {
            "name": knob.name,
            "unit": knob.unit,
            "text": number(float(value)),
            "differs": bool(differs),
        }
        for knob, value, differs in zip(
            space, experiment.theta, np.broadcast_to(differing, len(space)), strict=True
        )
    ]
