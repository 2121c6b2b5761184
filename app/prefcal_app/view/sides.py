"""Show two experiments beside each other: a question, and any other pair."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from prefcal_app.session import Question, Side
from prefcal_app.summary.compare import compared, measured_rows
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import maneuvers_of
from prefcal_env.experiments.panels import Plot
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.presentation.wording import ended_text, knob_number, number
from prefcal_scenarios.scenario import KPI, Scenario, panels_of

from .maneuvers import eventful, largest_difference
from .panels import panel_view
from .seen import Seen

Draws = Callable[[Experiment, Experiment], Sequence[Plot]]
"""Function of two runs that returns the panels which show both."""


def question_view(
    question: Question, scenario: Scenario, *, blind: bool, seen: Seen | None = None
) -> dict[str, Any]:
    """Return a question; with `blind`, numbers, roles and θ are not sent.

    Axes and large differences are based on all experiments `seen` so far.
    """
    left, right = question.left, question.right
    draws, seen = partial(panels_of, scenario), Seen() if seen is None else seen
    view = pair_view(left.experiment, right.experiment, draws, scenario.shown_kpis, seen)
    view["left"] |= side_view(left, right.experiment, scenario, blind=blind)
    view["right"] |= side_view(right, left.experiment, scenario, blind=blind)
    repeat = question.repeats is not None
    known = {"id": question.id, "number": question.number, "repeat": repeat, "further": question.further}
    return {**known, **view}


def pair_view(
    left: Experiment, right: Experiment, draws: Draws, kpis: Sequence[KPI], seen: Seen
) -> dict[str, Any]:
    """Return two experiments beside each other: their KPIs, and the curves of each maneuver.

    `comparison` has a row for each KPI that either side has, see `compared`; `others` are the
    maneuvers after the first one. Without maneuvers there is one part, whose name is empty.
    A run that failed without a record, or that ran before a maneuver was added, has no curves in
    the maneuvers that it lacks.
    """
    first, *others = (
        _maneuver_view(name, pair, draws(*pair), kpis, seen)
        for name, pair in maneuvers_of(left, right).items()
    )
    first["left"] |= numbers_view(left, kpis)
    first["right"] |= numbers_view(right, kpis)
    return {"comparison": compared(left, right, kpis, seen.spread), **first, "others": others}


def _maneuver_view(
    name: str, pair: Sequence[Experiment], panels: Sequence[Plot], kpis: Sequence[KPI], seen: Seen
) -> dict[str, Any]:
    """Return one maneuver of two experiments: its panels and axes, and the curves of both."""
    left, right = pair
    axes = seen.frame(panels, left, right, maneuver=name)
    return {
        "maneuver": name,
        "panels": [panel_view(panel) for panel in panels],
        "axes": axes,
        "window": eventful(panels, axes, left, right),
        "differ": largest_difference(panels, axes["y"], left, right),
        "left": run_view(left, panels, kpis, seen),
        "right": run_view(right, panels, kpis, seen),
    }


def run_view(run: Experiment, panels: Sequence[Plot], kpis: Sequence[KPI], seen: Seen) -> dict[str, Any]:
    """Return the curves of a run; of a maneuver its KPIs, too, and how it ended."""
    part = numbers_view(run, kpis) if run.maneuver else None
    return {**seen.drawn(run, panels), "part": part, "empty": not len(run.t)}


def side_view(side: Side, other: Experiment, scenario: Scenario, *, blind: bool) -> dict[str, Any]:
    """Return the part of an experiment in a question: its number, role, marks and θ."""
    return {
        "number": None if blind else side.index + 1,
        "role": None if blind else side.role,
        "marks": sorted(side.marks),
        "counts_as_unsafe": side.counts_as_unsafe,
        "theta": [] if blind else theta_view(scenario.space, side.experiment, other),
    }


def numbers_view(experiment: Experiment, kpis: Sequence[KPI]) -> dict[str, Any]:
    """Return how an experiment ended, and those of `kpis` that it has, limited ones first."""
    rows = measured_rows([kpi for kpi in kpis if kpi.name in experiment.kpis], experiment)
    rows.sort(key=lambda row: not row["objective"])
    return {
        "ended": ended_text(experiment),
        "interrupted": experiment.end.interrupted,
        "empty": not len(experiment.t),
        "kpis": rows,
    }


def knob_view(knob: Knob) -> dict[str, Any]:
    """Return what a knob is, with its range as numbers and in words."""
    return {
        **{name: getattr(knob, name) for name in ("name", "unit", "about", "scale", "integer")},
        "low": float(knob.low),
        "high": float(knob.high),
        "range": f"{number(knob.low)} to {number(knob.high)}",
    }


def theta_view(
    space: KnobSpace, experiment: Experiment, other: Experiment | None = None
) -> list[dict[str, Any]]:
    """Return θ with units, and whether each value as shown differs from that of `other`."""
    texts = theta_texts(space, experiment.theta)
    others = texts if other is None else theta_texts(space, other.theta)
    return [
        {"name": k.name, "about": k.about, "unit": k.unit, "text": text, "differs": text != its}
        for k, text, its in zip(space.knobs, texts, others, strict=True)
    ]


def theta_texts(space: KnobSpace, theta: Iterable[float]) -> list[str]:
    """Return the values of θ as people read them, without units."""
    return [knob_number(k, float(v)) for k, v in zip(space.knobs, theta, strict=True)]
