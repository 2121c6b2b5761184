"""Turn two runs into plain data for the page, in the form of a question of a study."""

from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import maneuvers_of
from prefcal_scenarios.app.summary.compare import Spread, compared
from prefcal_scenarios.app.web.view.drawn import curves_view
from prefcal_scenarios.app.web.view.maneuvers import eventful, largest_difference
from prefcal_scenarios.app.web.view.panels import panel_view
from prefcal_scenarios.app.web.view.seen import Seen
from prefcal_scenarios.app.web.view.sides import numbers_of

from .pair import Pair, Run


def pair_view(pair: Pair) -> dict[str, Any]:
    """Return PAIR for the page: what `question_view` returns, without a study."""
    first, *others = _maneuvers(pair)
    return {
        "id": f"{pair.left.name}\n{pair.right.name}",
        "time_unit": pair.left.experiment.channels.time_unit,
        "comparison": comparison(pair),
        **first,
        "left": {**_side(pair.left, pair), **first["left"]},
        "right": {**_side(pair.right, pair), **first["right"]},
        "others": others,
        "notes": list(pair.notes),
    }


def comparison(pair: Pair) -> list[dict[str, Any]]:
    """Return the KPIs of both runs with their differences, the largest first."""
    return compared(pair.left.experiment, pair.right.experiment, pair.kpis, Spread())


def _maneuvers(pair: Pair) -> list[dict[str, Any]]:
    """Return the curves of every maneuver; those of the runs themselves if they have none."""
    parts = maneuvers_of(pair.left.experiment, pair.right.experiment)
    return [_drawn(pair, name, *runs) for name, runs in parts.items()]


def _drawn(pair: Pair, maneuver: str, left: Experiment, right: Experiment) -> dict[str, Any]:
    axes = Seen().frame(pair.panels, left, right)
    return {
        "maneuver": maneuver,
        "panels": [panel_view(panel) for panel in pair.panels],
        "axes": axes,
        "window": eventful(pair.panels, axes, left, right),
        "differ": largest_difference(pair.panels, axes["y"], left, right),
        "left": _curves(left, pair),
        "right": _curves(right, pair),
    }


def _curves(run: Experiment, pair: Pair) -> dict[str, Any]:
    part = numbers_of(run, pair.kpis) if run.maneuver else None
    return {**curves_view(run, pair.panels), "part": part, "empty": not len(run.t)}


def _side(run: Run, pair: Pair) -> dict[str, Any]:
    """Return one run; it has no θ, no role and no marks."""
    return {
        **numbers_of(run.experiment, pair.kpis),
        "name": run.name,
        "about": run.about,
        "number": None,
        "role": None,
        "marks": None,
        "counts_as_unsafe": False,
        "theta": [],
    }
