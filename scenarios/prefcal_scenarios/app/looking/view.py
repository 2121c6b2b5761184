"""Turn two runs into plain data for the page, in the form of a question of a study."""

from typing import Any

from prefcal_scenarios.app.web.view.compare import compared
from prefcal_scenarios.app.web.view.drawn import curves_view
from prefcal_scenarios.app.web.view.panels import panel_view
from prefcal_scenarios.app.web.view.seen import Seen, axes_of
from prefcal_scenarios.app.web.view.sides import numbers_of

from .pair import Pair, Run


def pair_view(pair: Pair) -> dict[str, Any]:
    """Return PAIR for the page: what `question_view` returns, without a study."""
    shown = [(run.experiment, plots) for run, plots in pair.sides]
    left, right = (
        _side(run, curves_view(run.experiment, plots), pair) for run, plots in pair.sides
    )
    return {
        "id": f"{pair.left.name}\n{pair.right.name}",
        "time_unit": pair.left.experiment.channels.time_unit,
        "panels": [panel_view(panel) for panel in pair.panels],
        "axes": axes_of(pair.panels, *shown),
        "comparison": comparison(pair),
        "left": left,
        "right": right,
        "has_scene": False,
        "notes": list(pair.notes),
    }


def comparison(pair: Pair) -> list[dict[str, Any]]:
    """Return the KPIs of both runs with their differences, the largest first."""
    return compared(pair.left.experiment, pair.right.experiment, pair.kpis, Seen())


def _side(run: Run, drawn: dict[str, Any], pair: Pair) -> dict[str, Any]:
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
        **drawn,
        "scene": None,
    }
