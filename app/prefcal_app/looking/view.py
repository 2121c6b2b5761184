"""Turn two runs into plain data for the page, in the form of a question of a study."""

from typing import Any

from prefcal_app.summary.compare import Spread, compared
from prefcal_app.view import maneuvers
from prefcal_app.view.seen import Seen
from prefcal_app.view.sides import numbers_view
from prefcal_app.view.sides import pair_view as maneuver_view
from prefcal_env.experiments.maneuvers import maneuvers_of

from .pair import Pair, Run


def pair_view(pair: Pair) -> dict[str, Any]:
    """Return PAIR for the page: what `question_view` returns, without a study."""
    parts = maneuvers_of(pair.left.experiment, pair.right.experiment)
    first, *others = (
        maneuver_view(maneuvers.Pair(name, left, right, pair.panels), pair.kpis, Seen())
        for name, (left, right) in parts.items()
    )
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


def _side(run: Run, pair: Pair) -> dict[str, Any]:
    """Return one run; it has no θ, no role and no marks."""
    return {
        **numbers_view(run.experiment, pair.kpis),
        "name": run.name,
        "about": run.about,
        "number": None,
        "role": None,
        "marks": None,
        "counts_as_unsafe": False,
        "theta": [],
    }
