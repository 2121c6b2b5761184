"""Compare two experiments KPI by KPI, largest difference first, for page and terminal."""

from collections.abc import Sequence
from math import inf, isfinite, isnan
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.app.presentation.wording import measured, with_unit
from prefcal_scenarios.app.report.tables import objective
from prefcal_scenarios.app.session import Question
from prefcal_scenarios.kpis import grouped
from prefcal_scenarios.scenario import KPI, Scenario

from .seen import Seen

NOTICED = 0.02
"""Share of a KPI's value below which a difference never counts as large."""


def comparison_view(question: Question, scenario: Scenario, seen: Seen) -> list[dict[str, Any]]:
    """Return a row for each KPI that either side has, largest difference first in each group.

    `size` is the difference as a share of what is usual in this study (`Seen.spread`), at most 1;
    values that read the same do not differ. `better` is the better side by the KPI's goal, or None
    without a goal. `difference` is the right value minus the left one. `group` is "worst", "mean"
    or a maneuver, or "" if the experiments have no maneuvers.
    """
    sides = question.left.experiment, question.right.experiment
    return compared(*sides, scenario.shown_kpis, seen)


def compared(
    left: Experiment, right: Experiment, known: Sequence[KPI], seen: Seen
) -> list[dict[str, Any]]:
    """Return the rows of `comparison_view` for two experiments and these KPIs."""
    kpis = grouped(known, left, right)
    rows = [(group, _size(kpi, left, right, seen), kpi) for group, kpi in kpis]
    order = list(dict.fromkeys(group for group, _ in kpis))
    # Stable: more important KPIs first among equals.
    rows.sort(key=lambda row: (order.index(row[0]), -row[1]))
    return [{"group": group, **_row(kpi, left, right, size)} for group, size, kpi in rows]


def _row(kpi: KPI, left: Experiment, right: Experiment, size: float) -> dict[str, Any]:
    words = objective(kpi)
    return {
        "title": kpi.title,
        "about": kpi.about,
        "unit": kpi.unit,
        "objective": f"{words} {kpi.unit}".strip() if words else "",
        "left": _value(kpi, left),
        "right": _value(kpi, right),
        "difference": _difference(kpi, left, right) if size else "",
        "better": _better(kpi, left, right) if size else None,
        "size": round(min(size, 1.0), 3),
    }  # fmt: skip


def _value(kpi: KPI, experiment: Experiment) -> dict[str, Any]:
    return {"text": measured(kpi, experiment), "met": kpi.met_by(experiment)}


def _pair(kpi: KPI, left: Experiment, right: Experiment) -> tuple[float, float]:
    return tuple(float(e.kpis.get(kpi.name, float("nan"))) for e in (left, right))  # type: ignore[return-value]


def _size(kpi: KPI, left: Experiment, right: Experiment, seen: Seen) -> float:
    """Return how large the difference is; 0 if both values read the same."""
    if measured(kpi, left) == measured(kpi, right):
        return 0.0
    a, b = _pair(kpi, left, right)
    if not (isfinite(a) and isfinite(b)):
        return inf
    usual = max(seen.spread(kpi.name, a, b), NOTICED * max(abs(a), abs(b)))
    return abs(b - a) / usual


def _difference(kpi: KPI, left: Experiment, right: Experiment) -> str:
    a, b = _pair(kpi, left, right)
    if not (isfinite(a) and isfinite(b)):
        return ""
    size = abs(b - a)
    text = f"{size:.3g}" if size < 1e3 else f"{size:.0f}"
    return with_unit(("+" if b > a else "−") + text, kpi.unit)


def _better(kpi: KPI, left: Experiment, right: Experiment) -> str | None:
    if kpi.goal is None:
        return None
    a, b = (kpi.badness(v) for v in _pair(kpi, left, right))
    if isnan(a) or isnan(b) or a == b:
        return None
    return "left" if a < b else "right"
