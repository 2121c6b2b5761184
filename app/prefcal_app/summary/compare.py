"""Compare two experiments KPI by KPI, what tells them apart first, for page and terminal."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, isnan, nan
from typing import Any

import numpy as np

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.kpis import grouped
from prefcal_scenarios.presentation.wording import limits_text, measured_texts, with_unit
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
    order = list(dict.fromkeys(group for group, _ in kpis))
    pairs = _pairs([kpi for _, kpi in kpis], left, right)
    rows = [(group, _size(pair, spread), pair) for (group, _), pair in zip(kpis, pairs, strict=True)]
    # Stable: more important KPIs first among equals.
    rows.sort(key=lambda row: (order.index(row[0]), {*row[2].met} != {True, False}, -row[1]))
    return [{"group": group, **_row(pair, size)} for group, size, pair in rows]


def unmeasured(left: Experiment, right: Experiment, kpis: Sequence[KPI]) -> list[dict[str, Any]]:
    """Return the rows, without a group, of KPIs that neither side has."""
    return [_row(pair, 0.0) for pair in _pairs(kpis, left, right)]


def measured_rows(kpis: Sequence[KPI], experiment: Experiment) -> list[dict[str, Any]]:
    """Return what each KPI is called and what it should be, its value, and whether that is met."""
    met, texts = [kpi.met_by(experiment) for kpi in kpis], measured_texts(kpis, experiment)
    each = zip(map(_words, kpis, map(limits_text, kpis)), texts, met, strict=True)
    return [{**words, "text": text, "met": one} for words, text, one in each]


@dataclass(frozen=True, slots=True)
class _Pair:
    """What people read of one KPI of two experiments, left and right.

    Args:
        kpi: The KPI.
        objective: Its objective in words.
        values: Values as read, in its unit; NaN where one is missing.
        texts: Values in words.
        met: Whether each meets the objective; None without one or a value.
        judged: How bad each value looks, see `KPI.judged`.
        apart: Size of the difference as read, in its unit.
    """

    kpi: KPI
    objective: str
    values: tuple[float, float]
    texts: tuple[str, str]
    met: tuple[bool | None, bool | None]
    judged: tuple[float, float]
    apart: float


def _pairs(kpis: Sequence[KPI], left: Experiment, right: Experiment) -> list[_Pair]:
    """Return what people read of all KPIs: each number is read once, and each text made once."""
    values = [[float(e.kpis.get(kpi.name, nan)) for e in (left, right)] for kpi in kpis]
    read = [(kpi.read(a), kpi.read(b)) for kpi, (a, b) in zip(kpis, values, strict=True)]
    judged = [(kpi.judged(a), kpi.judged(b)) for kpi, (a, b) in zip(kpis, read, strict=True)]
    apart = [kpi.read(abs(b - a)) for kpi, (a, b) in zip(kpis, read, strict=True)]
    met = [(kpi.met_by(left), kpi.met_by(right)) for kpi in kpis]
    texts = zip(*(measured_texts(kpis, e) for e in (left, right)), strict=True)
    return list(map(_Pair, kpis, map(limits_text, kpis), read, texts, met, judged, apart))


def _row(pair: _Pair, size: float) -> dict[str, Any]:
    """Return the row of one KPI, without its group."""
    left, right = ({"text": text, "met": met} for text, met in zip(pair.texts, pair.met, strict=True))
    return {
        **_words(pair.kpi, pair.objective),
        "left": left,
        "right": right,
        "difference": _difference(pair) if size else "",
        "better": _better(pair) if size else None,
        "size": round(min(size, 1.0), 3),
        "change": round(min(size, _share(*pair.values)), 3),
    }


def _words(kpi: KPI, objective: str) -> dict[str, str]:
    """Return what a KPI is called, and what it should be."""
    return {"title": kpi.title, "about": kpi.about, "unit": kpi.unit, "objective": objective}


def _size(pair: _Pair, spread: Spread) -> float:
    """Return how large the difference is; 0 if both read the same, or meet a target alike."""
    a, b = pair.values
    alike = pair.kpi.goal is not None and pair.judged[0] == pair.judged[1]
    if alike or pair.texts[0] == pair.texts[1]:
        return 0.0
    if not (isfinite(a) and isfinite(b)):
        return inf
    usual = max(spread(pair.kpi.name, a, b), NOTICED * max(abs(a), abs(b)))
    return abs(b - a) / usual


def _share(a: float, b: float) -> float:
    """Return the difference as a share of the larger value; 1 if one is infinite or missing."""
    if not (isfinite(a) and isfinite(b)):
        return 1.0
    return abs(b - a) / (max(abs(a), abs(b)) or 1.0)


def _difference(pair: _Pair) -> str:
    """Return the right value minus the left one, with sign and unit; "" if it is not a number."""
    a, b = pair.values
    if not (isfinite(a) and isfinite(b)):
        return ""
    size = pair.apart
    text = f"{size:.3g}" if 1e-4 <= size < 1e3 else f"{size:.12f}".rstrip("0").rstrip(".")
    return with_unit(("+" if b > a else "−") + text, pair.kpi.unit)


def _better(pair: _Pair) -> str | None:
    """Return the side whose value is better; None if that is not known."""
    left, right = pair.judged
    if pair.kpi.goal is None or isnan(left) or isnan(right) or left == right:
        return None
    return "left" if left < right else "right"
