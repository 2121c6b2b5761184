"""Compare two experiments KPI by KPI, what tells them apart first, for page and terminal."""

from collections.abc import Iterable, Mapping, Sequence
from math import inf, isfinite, isnan
from typing import Any

import numpy as np

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.kpis import grouped
from prefcal_scenarios.presentation.wording import limits_text, measured, with_unit
from prefcal_scenarios.scenario import KPI

_FEW = 4
"""Minimum number of experiments whose spread tells what a large difference is."""
NOTICED = 0.02
"""Share of a KPI's value below which a difference never counts as large."""


class Spread:
    """How far apart the KPIs of a study usually are.

    Args:
        known: KPIs of each experiment by name.
    """

    def __init__(self, known: Iterable[Mapping[str, float]] = ()) -> None:
        self._known = list(known)

    def __call__(self, kpi: str, *values: float) -> float:
        """Return how far apart this KPI's values usually are, in its unit.

        This is the range of the middle half of all experiments so far, or of all if that is 0;
        with fewer than four experiments, the largest of `values`.
        """
        known = np.array([kpis[kpi] for kpis in self._known if kpi in kpis])
        known = known[np.isfinite(known)]
        if len(known) < _FEW:
            return max((abs(v) for v in values), default=0.0)
        low, high = np.percentile(known, [25, 75])
        return float(high - low) or float(np.ptp(known)) or max(abs(v) for v in values)


def compared(
    left: Experiment, right: Experiment, known: Sequence[KPI], spread: Spread
) -> list[dict[str, Any]]:
    """Return a row for each KPI that either side has, what tells them apart first in each group.

    That is an objective that only one side misses, then the largest difference. `size` is the
    difference as a share of what is usual in this study (`Spread`), at most 1;
    values that read the same do not differ. `change` is the same, but at most the difference
    as a share of the larger value. `better` is the better side by the KPI's goal, or None
    without a goal. `difference` is the right value minus the left one. `group` is "worst", "mean"
    or a maneuver, or "" if the experiments have no maneuvers.
    """
    kpis = grouped(known, left, right)
    rows = [(group, _size(kpi, left, right, spread), kpi) for group, kpi in kpis]
    order = list(dict.fromkeys(group for group, _ in kpis))
    # Stable: more important KPIs first among equals.
    rows.sort(key=lambda row: (order.index(row[0]), not one_misses(row[2], left, right), -row[1]))
    return [{"group": group, **row_of(kpi, left, right, size)} for group, size, kpi in rows]


def one_misses(kpi: KPI, left: Experiment, right: Experiment) -> bool:
    """Return whether one of two experiments meets the objective of a KPI and the other does not."""
    return {kpi.met_by(left), kpi.met_by(right)} == {True, False}


def row_of(kpi: KPI, left: Experiment, right: Experiment, size: float) -> dict[str, Any]:
    """Return the row of one KPI, without its group."""
    a, b = _pair(kpi, left, right)
    return {
        **words_of(kpi),
        "left": _value(kpi, left),
        "right": _value(kpi, right),
        "difference": _difference(kpi, a, b) if size else "",
        "better": _better(kpi, a, b) if size else None,
        "size": round(min(size, 1.0), 3),
        "change": round(min(size, _share(a, b)), 3),
    }


def words_of(kpi: KPI) -> dict[str, str]:
    """Return what a KPI is called, and what it should be."""
    about, objective = kpi.about, limits_text(kpi)
    return {"title": kpi.title, "about": about, "unit": kpi.unit, "objective": objective}


def _value(kpi: KPI, experiment: Experiment) -> dict[str, Any]:
    return {"text": measured(kpi, experiment), "met": kpi.met_by(experiment)}


def _pair(kpi: KPI, left: Experiment, right: Experiment) -> tuple[float, float]:
    values = (float(e.kpis.get(kpi.name, float("nan"))) for e in (left, right))
    return tuple(map(kpi.read, values))  # type: ignore[return-value]


def _size(kpi: KPI, left: Experiment, right: Experiment, spread: Spread) -> float:
    """Return how large the difference is; 0 if both read the same, or meet a target alike."""
    a, b = _pair(kpi, left, right)
    alike = kpi.goal is not None and kpi.judged(a) == kpi.judged(b)
    if alike or measured(kpi, left) == measured(kpi, right):
        return 0.0
    if not (isfinite(a) and isfinite(b)):
        return inf
    usual = max(spread(kpi.name, a, b), NOTICED * max(abs(a), abs(b)))
    return abs(b - a) / usual


def _share(a: float, b: float) -> float:
    """Return the difference as a share of the larger value; 1 if one is infinite or missing."""
    if not (isfinite(a) and isfinite(b)):
        return 1.0
    return abs(b - a) / (max(abs(a), abs(b)) or 1.0)


def _difference(kpi: KPI, a: float, b: float) -> str:
    """Return the right value `b` minus the left one, with sign and unit; "" if it is not a number."""
    if not (isfinite(a) and isfinite(b)):
        return ""
    size = kpi.read(abs(b - a))
    text = f"{size:.3g}" if 1e-4 <= size < 1e3 else f"{size:.12f}".rstrip("0").rstrip(".")
    return with_unit(("+" if b > a else "−") + text, kpi.unit)


def _better(kpi: KPI, a: float, b: float) -> str | None:
    """Return the side whose value, `a` on the left or `b`, is better; None if that is not known."""
    if kpi.goal is None:
        return None
    left, right = kpi.judged(a), kpi.judged(b)
    if isnan(left) or isnan(right) or left == right:
        return None
    return "left" if left < right else "right"
