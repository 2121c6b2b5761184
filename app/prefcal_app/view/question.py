"""A question as plain data: its two sides, their panels and maneuvers, and previews."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from math import isfinite, isinf, isnan
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_app.session import Interview, Preview, Question, Side
from prefcal_app.session.actions import Record
from prefcal_app.session.study import PlantNow, Recovery
from prefcal_app.summary import Spread, compare, measured_rows
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.panels import PanelCurves, Plot, by_maneuver, maneuvers_of, panel_curves
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.sources import Change, Stage
from prefcal_scenarios.scenario import KPI, Scenario, panels_of
from prefcal_scenarios.wording import (
    counted,
    ended_text,
    exact_number,
    knob_number,
    limits_text,
    meaning,
    measured,
    number,
    quantity,
    typed_name,
)

# --- Tables as plain data, which the page, the terminal and the report draw as they are.

Data = dict[str, Any]


def table(
    label: str, columns: Iterable[Data | str], rows: Iterable[Data], caption: str = "", kind: str = "result"
) -> Data:
    """Return a table.

    Args:
        label: Name of the table, for screen readers.
        columns: What `column` returns, or a heading alone; the first one is that of the rows' names.
        rows: What `row` returns.
        caption: What the signs mean; empty for none.
        kind: Classes of the style sheet.
    """
    heads = [column(each) if isinstance(each, str) else each for each in columns]
    return {"label": label, "columns": heads, "rows": list(rows), "caption": caption, "kind": kind}


def column(name: str, unit: str = "", kind: str = "") -> Data:
    """Return the heading of a column, with the unit of its values and its classes."""
    return {"name": name, "unit": unit, "kind": kind}


def row(
    name: str, cells: Sequence[Data], *, unit: str = "", aim: str = "", about: str = "", kind: str = ""
) -> Data:
    """Return a row.

    Args:
        cells: What `cell` returns, one for each column but the first.
        unit: Unit of the values; empty for none.
        aim: Objective as text; empty for none.
        about: What the heading means; empty for nothing.
        kind: Classes of the row.
    """
    return {"name": name, "cells": list(cells), "unit": unit, "aim": aim, "about": about, "kind": kind}


def cell(text: str, met: bool | None = None, kind: str = "") -> Data:
    """Return a cell.

    Args:
        met: Whether the value meets its objective; None if there is none.
        kind: Classes of the style sheet: "best", "words", "yes" or "no"; empty for none.
    """
    return {"text": text, "met": met, "kind": kind}


def judged(kpi: KPI, experiment: Experiment, kind: str = "") -> Data:
    """Return the cell of a KPI: its value, and whether that meets the objective."""
    return cell(measured(kpi, experiment), kpi.met_by(experiment), kind)


# --- Describe the panels of a question and compute the curves to draw.

_MOST = 4000  # maximum number of points of a curve; longer ones keep minimum and maximum of each stretch


def panel_view(panel: Plot) -> dict[str, Any]:
    """Return title, unit, target and limits of a panel."""
    channel, symbol = panel.channel, panel.channel.symbol
    return {
        "title": channel.name if symbol in ("", channel.name) else f"{channel.name} {symbol}",
        "symbol": symbol or channel.name,
        "unit": channel.unit,
        "shape": "step" if panel.held else "line",
        "low": _plain(channel.low),
        "high": _plain(channel.high),
        "changing": [bool(panel.low_signal), bool(panel.high_signal)],
        "target": channel.target,
        "band": channel.band,
    }


def curves_view(experiment: Experiment, panels: Sequence[Plot]) -> dict[str, Any]:
    """Return curves, changing references and limits, and each panel in words."""
    runs = experiment.runs or (experiment,)
    recorded = runs if len(experiment.t) else ()
    found, t = [panel_curves(panels, run) for run in runs], runs[0].t
    beside = [
        [None if values is None else curve(t, values, held=True) for values in each[1:]] for each in found[0]
    ]
    return {
        "runs": len(runs),
        "curves": [
            [
                curve(run.t, each[i].values, held=panel.held)
                for run, each in zip(recorded, found, strict=False)
                if np.isfinite(each[i].values).any()
            ]
            for i, panel in enumerate(panels)
        ],
        "references": [reference for reference, _, _ in beside],
        "limits": [limits for _, *limits in beside],
        "stories": [
            _story(panel.channel, runs[0], each.values) for panel, each in zip(panels, found[0], strict=True)
        ],
    }


def curve(t: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"], *, held: bool) -> dict[str, Any]:
    """Return the points to draw, to six digits: changes of a held value, or the dense grid."""
    kept = _changes(y) if held else _extremes(y)
    return {"t": _round(t[kept]), "y": _round(y[kept])}


def _changes(y: Float[np.ndarray, " K"]) -> np.ndarray:
    changed = np.flatnonzero(y[1:] != y[:-1]) + 1
    return np.unique(np.concatenate([[0], changed, [len(y) - 1]]))


def _extremes(y: Float[np.ndarray, " K"]) -> np.ndarray:
    if len(y) <= _MOST:
        return np.arange(len(y))
    # Half of the points follow time, half of them movement: a spike of minutes in hours is a curve, too.
    moves = np.abs(np.diff(y, prepend=y[0]))
    moves[~np.isfinite(moves)] = 0.0
    share = np.cumsum(moves / max(moves.sum(), 1e-300) + 1 / len(y))
    cuts = np.searchsorted(share, np.linspace(0, share[-1], _MOST // 2 + 1)[1:-1])
    parts = np.split(np.arange(len(y)), np.unique(cuts[cuts > 0]))
    low, high = np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), -np.inf, y)
    kept = [k for p in parts for k in (p[np.argmin(low[p])], p[np.argmax(high[p])])]
    return np.unique(np.concatenate([[0], kept, [len(y) - 1]]))


def _round(values: Float[np.ndarray, " K"]) -> list[float | None]:
    """Return the values to six digits; NaN and infinity become None, a gap in the curve."""
    values = np.asarray(values, dtype=float)
    finite = np.isfinite(values)
    if not finite.all():
        drawn = zip(_round(np.where(finite, values, 0.0)), finite, strict=True)
        return [value if there else None for value, there in drawn]
    size = np.where(values == 0, 1.0, np.abs(values))
    places = 5 - np.floor(np.log10(size))
    # Multiply and divide by whole powers of ten only, so that the results have no stray digits.
    up, down = 10.0 ** np.maximum(places, 0), 10.0 ** np.maximum(-places, 0)
    rounded: list[float | None] = (np.round(values * up / down) * down / up + 0.0).tolist()
    return rounded


def _story(channel: Channel, experiment: Experiment, y: Float[np.ndarray, " K"]) -> str:
    """Return a curve in words, for people who cannot see it."""
    if not len(experiment.t):
        return f"{channel.name}: no record"
    t, y = experiment.t[np.isfinite(y)], y[np.isfinite(y)]
    if not len(y):
        return f"{channel.name}: no values"
    words = (
        f"{channel.name}: from {number(float(y[0]))} to {quantity(float(y[-1]), channel.unit)}, "
        f"lowest {number(float(y.min()))}, highest {number(float(y.max()))}"
    )
    if channel.target is None or channel.band is None:
        return words
    outside = np.flatnonzero(np.abs(y - channel.target) > channel.band)
    target = f"the band around {number(channel.target)}"
    if not len(outside):
        return f"{words}, inside {target} all the time"
    if outside[-1] == len(t) - 1:
        return f"{words}, outside {target} at the end"
    since = quantity(float(t[outside[-1] + 1]), experiment.channels.time_unit)
    return f"{words}, inside {target} from {since} on"


# --- Track the ranges of all experiments of a study, for axes and for KPI differences.

_PAD = 0.04  # share of an axis left free at each end
_GRAIN = 20  # steps of an axis, up to twice as many: axes end at a step, so small growth moves nothing
_KEPT = 24  # number of runs whose curves are kept for the page: those of the last questions
_AT_ONCE = 200  # number of experiments read per look, to avoid waiting while thousands load from disk

Range = tuple[float, float]
_Drawn = tuple[Experiment, Sequence[Plot], dict[str, Any]]
_NOTHING: Range = (np.inf, -np.inf)


@dataclass(frozen=True, slots=True)
class _Reach:
    """The range of one experiment in time and in each of its panels."""

    t: Range
    y: tuple[Range, ...]


@dataclass(slots=True)
class Seen:
    """Results computed for a study's experiments; each experiment is read once.

    Axes only grow, so that a height on the screen means the same in every question.
    """

    _reach: dict[int, dict[str, _Reach]] = field(default_factory=dict)
    _kpis: dict[int, dict[str, float]] = field(default_factory=dict)
    _drawn: dict[int, _Drawn] = field(default_factory=dict)

    def look(self, interview: Interview) -> "Seen":
        """Read experiments that finished since the last look, and return `self`.

        Each look reads a limited number, newest first, so a long study loads in several looks.
        """
        finished = interview.file.state.finished.items()
        new = sorted((index, seq) for index, seq in finished if seq not in self._reach)
        for index, seq in new[-_AT_ONCE:]:
            experiment = interview.past.experiment(index)
            self._reach[seq] = {
                name: _reach(run, panels_of(interview.scenario, run))
                for name, run in by_maneuver(experiment).items()
            }
            self._kpis[seq] = dict(experiment.kpis)
        return self

    def frame(self, panels: Sequence[Plot], *shown: Experiment, maneuver: str = "") -> dict[str, Any]:
        """Return the axes of all experiments so far and of `shown`: `x`, and `y` by panel.

        Each maneuver has axes of its own; `shown` are runs of it.
        """
        known = [parts[maneuver] for parts in self._reach.values() if maneuver in parts]
        reached = [reach for reach in known if len(reach.y) == len(panels)]
        reached += [_reach(experiment, panels) for experiment in shown]
        t = _union(r.t for r in reached)
        y = [_grow(panel, [r.y[i] for r in reached]) for i, panel in enumerate(panels)]
        return {"x": list(snapped(*t)) if t[0] < t[1] else [0.0, 1.0], "y": [list(range_) for range_ in y]}

    @property
    def spread(self) -> Spread:
        """Return how far apart the KPIs of the experiments so far usually are."""
        return Spread(self._kpis.values())

    def drawn(self, experiment: Experiment, panels: Sequence[Plot]) -> dict[str, Any]:
        """Return `curves_view`, cached because the best so far appears in every question."""
        kept = self._drawn.get(id(experiment))
        if kept is None or kept[0] is not experiment or kept[1] != panels:
            while len(self._drawn) >= _KEPT:
                del self._drawn[next(iter(self._drawn))]
            kept = (experiment, panels, curves_view(experiment, panels))
            self._drawn[id(experiment)] = kept
        return kept[2]


def _reach(experiment: Experiment, panels: Sequence[Plot]) -> _Reach:
    runs = [run for run in experiment.runs or (experiment,) if len(run.t)]
    t = _union((float(run.t[0]), float(run.t[-1])) for run in runs)
    curves = [panel_curves(panels, run) for run in runs]
    known = [[v for each in curves for v in each[i] if v is not None] for i in range(len(panels))]
    return _Reach(t, tuple(_union(map(_range, values)) for values in known))


def _range(values: Float[np.ndarray, " K"]) -> Range:
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else _NOTHING


def _union(ranges: Iterator[Range]) -> Range:
    low, high = _NOTHING
    for a, b in ranges:
        low, high = min(low, a), max(high, b)
    return low, high


def _grow(panel: Plot, ranges: Sequence[Range]) -> Range:
    """Return an axis that covers those of the first runs, of the first two, and so on: rounding alone,
    in other steps for more runs, would take some of it away."""
    reached, axis = _NOTHING, _NOTHING if ranges else _axis(panel, _NOTHING)
    for each in ranges:
        before, reached = reached, _union(iter((reached, each)))
        if reached != before or axis == _NOTHING:
            axis = _union(iter((axis, _axis(panel, reached))))
    return axis


def _axis(panel: Plot, reached: Range) -> Range:
    """Return the axis of a panel from the range of its curves and its target with band."""
    channel, (low, high) = panel.channel, reached
    if channel.target is not None:
        band = channel.band or 0.0
        low, high = min(low, channel.target - band), max(high, channel.target + band)
    low, high = _frame(channel, low, high, whole=panel.kind == "u")
    if not low < high:
        middle = low if low == high else 0.0
        return middle - 1.0, middle + 1.0
    low, high = snapped(low, high)
    pad = _PAD * (high - low)
    return low - pad, high + pad


def snapped(low: float, high: float, grain: int = _GRAIN) -> Range:
    """Round a range outwards to at least `grain` steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / grain
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(next((m for m in (5, 2) if m * power <= rough), 1) * power)
    return step * float(np.floor(low / step + 1e-9)), step * float(np.ceil(high / step - 1e-9))


def _frame(channel: Channel, low: float, high: float, *, whole: bool) -> Range:
    """Extend a range to limits that the curves come near; distant ones would flatten the curves.

    A range covers at least a hundredth of the allowed span: below that, nothing that matters is magnified.
    It is the `whole` span, of an input, from a twentieth on: the next run moves it elsewhere, and the axis
    would jump.
    """
    limits = [limit for limit in (channel.low, channel.high) if np.isfinite(limit)]
    if not low <= high:
        return (limits[0], limits[-1]) if limits else (low, high)
    allowed = channel.high - channel.low if len(limits) > 1 else 0.0
    middle, span = (low + high) / 2, max(high - low, allowed / 100)
    near = [limit for limit in limits if max(low - limit, limit - high) <= 2 * span]
    near = limits if whole and 0 < allowed <= 20 * (high - low) else near
    return min(low, middle - span / 2, *near), max(high, middle + span / 2, *near)


# --- Find when things happen in a maneuver of two experiments, and where both differ.

_STILL = 0.02  # share of its axis by which a curve may move while nothing happens
_BEFORE, _AFTER = 0.05, 0.25  # shares of the time in which things happen that are shown before and after it
_COARSE = 3
"""Steps of the time shown, up to twice as many: a similar pair has the same time axis, and is drawn
in a tenth of the time."""
_NEARLY_ALL = 0.8  # share of the whole time from which all of it is shown
_FEW, _PARTS, _APART = 1 / 3, 3, 0.1
"""Share of the time from first to last movement below which only the parts with movement are shown,
the largest number of parts, and the least share of it between two."""
_STRETCHES = 1000  # largest number of stretches of a curve in which movement is looked for


def largest_difference(
    panels: Sequence[Plot], heights: Sequence[tuple[float, float]], left: Experiment, right: Experiment
) -> dict[str, Any] | None:
    """Return where the curves of two runs differ most, relative to the axes of their panels.

    Only the time that both runs cover counts, and inputs only if nothing else is drawn: at the
    first instant of a step they differ by their full range without telling the runs apart.

    Args:
        heights: Ends of the axis of each panel, in the panel's unit.

    Returns:
        The time `t`, the number of the `panel`, and the `size` as a share of its axis; None if
        nothing differs.
    """
    if not len(left.t) or not len(right.t):
        return None
    t = np.union1d(left.t, right.t)
    t = t[(t >= max(left.t[0], right.t[0])) & (t <= min(left.t[-1], right.t[-1]))]
    held = [panel.held for panel in panels]
    a, b = (_on(t, panel_curves(panels, run), held, run.t) for run in (left, right))
    responses = [i for i, steps in enumerate(held) if not steps]
    largest = None
    for i in responses or range(len(panels)):
        apart = np.abs(a[i] - b[i])
        if not np.isfinite(apart).any():
            continue
        at, (low, high) = int(np.nanargmax(apart)), heights[i]
        size = float(apart[at] / (high - low))
        if size > (0.0 if largest is None else largest["size"]):
            largest = {"t": float(f"{t[at]:.6g}"), "panel": i, "size": round(size, 4)}
    return largest


def eventful(panels: Sequence[Plot], axes: dict[str, Any], *shown: Experiment) -> list[list[float]]:
    """Return the parts of the time axis in which things happen in any of some runs.

    That is from the first time any curve, reference or limit moves until all of them stay near
    their last value: within the band of a target, and within 2 % of the axis. It is one part, unless
    things happen in less than a third of it, as after a step and a load hours apart, and no curve drifts
    by more than 2 % of the axis between these parts.

    Args:
        axes: Axes of the panels: `x`, and `y` by panel.
    """
    first, last = axes["x"]
    runs = [run for experiment in shown for run in experiment.runs or (experiment,) if len(run.t)]
    found = [
        moved
        for run in runs
        for panel, curves, (low, high) in zip(panels, panel_curves(panels, run), axes["y"], strict=True)
        for moved in _movements(panel.channel, run.t, curves, _STILL * (high - low))
    ]
    if not found:
        return [[first, last]]
    start, end = min(each[0][0] for each in found), max(each[-1][1] for each in found)
    if not start < end:
        return [[first, last]]
    apart = [_around(*part, first, last) for part in _join(found, _APART * (end - start))]
    if 1 < len(apart) <= _PARTS and sum(b - a for a, b in apart) < _FEW * (end - start):
        gaps = np.array([[a[1], b[0]] for a, b in pairwise(apart)])
        if not any(_drifts(panel_curves(panels, run), run.t, gaps, axes["y"]) for run in runs):
            return apart
    start, end = _around(start, end, first, last)
    return [[first, last] if end - start > _NEARLY_ALL * (last - first) else [start, end]]


def _drifts(
    panels: Sequence[Sequence[Float[np.ndarray, " K"] | None]],
    t: Float[np.ndarray, " K"],
    gaps: Float[np.ndarray, "m 2"],
    heights: Sequence[Sequence[float]],
) -> bool:
    """Return whether any curve moves by more than is still in `gaps` in the time, taken together."""
    for curves, (low, high) in zip(panels, heights, strict=True):
        for values in curves:
            if values is not None and (known := np.isfinite(values)).any():
                drift = np.abs(np.diff(np.interp(gaps, t[known], values[known]))).sum()
                if drift > _STILL * (high - low):
                    return True
    return False


def _around(start: float, end: float, first: float, last: float) -> list[float]:
    """Return a part of the time with what is shown before and after it, from `first` to `last` at most."""
    width = end - start
    shown = snapped(start - _BEFORE * width, end + _AFTER * width, _COARSE)
    return [max(shown[0], first), min(shown[1], last)]


def _join(found: Iterable[Sequence[Range]], gap: float) -> list[Range]:
    """Return the union of ranges, in order, where those less than `gap` apart are one."""
    parts: list[Range] = []
    for low, high in sorted(range_ for each in found for range_ in each):
        if parts and low - parts[-1][1] < gap:
            low, high = parts[-1][0], max(parts.pop()[1], high)
        parts.append((low, high))
    return parts


def _movements(
    channel: Channel, t: Float[np.ndarray, " K"], curves: PanelCurves, still: float
) -> Iterator[list[Range]]:
    """Yield for each curve of a panel that moves by more than `still` from when until when it does."""
    if channel.target is not None and channel.band:
        still = min(still, channel.band)
    for values in curves:
        if values is None or not (known := np.isfinite(values)).any():
            continue
        at, y = t[known], values[known]
        moved, unsettled = (np.flatnonzero(np.abs(y - end) > still) for end in (y[0], y[-1]))
        if not len(moved) or not len(unsettled):
            continue
        begins, ends = sorted((max(moved[0] - 1, 0), min(unsettled[-1] + 1, len(at) - 1)))
        if begins < ends:
            first, last = ((float(at[k]), float(at[k + 1])) for k in (begins, ends - 1))
            part = slice(begins, ends + 1)
            yield [first, *_moving(at[part], y[part], still), last]


def _moving(t: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"], still: float) -> Iterator[Range]:
    """Yield the times between rows at which a curve is more than `still` from where it was last seen to move.

    A curve of very many rows is looked at in stretches of some, each by its extremes.
    """
    starts = np.unique(np.linspace(0, len(y) - 1, min(len(y), _STRETCHES)).astype(int))
    low, high = (f.reduceat(y, starts).tolist() for f in (np.minimum, np.maximum))
    ends, since = [*starts[1:].tolist(), len(y) - 1], float(y[0])
    for k, (a, b) in enumerate(zip(low, high, strict=True)):
        if max(b - since, since - a) > still:
            yield float(t[max(starts[k] - 1, 0)]), float(t[ends[k]])
            since = float(y[ends[k] - 1] if k + 1 < len(low) else y[-1])


def _on(
    t: Float[np.ndarray, " M"],
    curves: Sequence[PanelCurves],
    held: Sequence[bool],
    own: Float[np.ndarray, " K"],
) -> list[Float[np.ndarray, " M"]]:
    """Return curves on `own` instants at others: the last value of an input, else between two."""
    last = np.searchsorted(own, t, side="right") - 1
    return [
        each.values[last] if steps else np.interp(t, own, each.values)
        for each, steps in zip(curves, held, strict=True)
    ]


# --- Show two experiments beside each other: a question, and any other pair.

_HEADS = 3  # KPIs in the head of each side, or as many as the sentence names

Draws = Callable[[Experiment, Experiment], Sequence[Plot]]
"""Function of two runs that returns the panels which show both."""


def question_view(
    question: Question,
    scenario: Scenario,
    *,
    blind: bool,
    seen: Seen | None = None,
    named: Sequence[str] = (),
) -> dict[str, Any]:
    """Return a question; with `blind`, numbers, roles and θ are not sent.

    Axes and large differences are based on all experiments `seen` so far. `named` are the titles
    of the KPIs that the sentence above the question names.
    """
    left, right = question.left, question.right
    draws, seen = partial(panels_of, scenario), Seen() if seen is None else seen
    view = pair_view(left.experiment, right.experiment, draws, scenario.shown_kpis, seen, named)
    view["left"] |= side_view(left, right.experiment, scenario, blind=blind)
    view["right"] |= side_view(right, left.experiment, scenario, blind=blind)
    repeat = question.repeats is not None
    known = {"id": question.id, "number": question.number, "repeat": repeat, "further": question.further}
    return {**known, **view}


def pair_view(
    left: Experiment,
    right: Experiment,
    draws: Draws,
    kpis: Sequence[KPI],
    seen: Seen,
    named: Sequence[str] = (),
) -> dict[str, Any]:
    """Return two experiments beside each other: their KPIs, and the curves of each maneuver.

    `comparison` has a row for each KPI that either side has, see `compare`; `headline` has their
    titles in the same order, of which the head of each side shows `heads`; `others` are the maneuvers
    after the first one. Without maneuvers there is one part, whose name is empty.
    A run that failed without a record, or that ran before a maneuver was added, has no curves in
    the maneuvers that it lacks.
    """
    first, *others = (
        _maneuver_view(name, pair, draws(*pair), kpis, seen)
        for name, pair in maneuvers_of(left, right).items()
    )
    first["left"] |= numbers_view(left, kpis, right)
    first["right"] |= numbers_view(right, kpis, left)
    rows = compare(left, right, kpis, seen.spread, named)
    shown = {each["title"] for each in rows}.intersection(named)
    heads = {
        "headline": list(dict.fromkeys(each["title"] for each in rows)),
        "heads": max(_HEADS, len(shown)),
    }
    return {"comparison": rows, **heads, **first, "others": others}


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
        "windows": eventful(panels, axes, left, right),
        "differ": largest_difference(panels, axes["y"], left, right),
        "left": run_view(left, panels, kpis, seen, right),
        "right": run_view(right, panels, kpis, seen, left),
    }


def run_view(
    run: Experiment, panels: Sequence[Plot], kpis: Sequence[KPI], seen: Seen, beside: Experiment | None = None
) -> dict[str, Any]:
    """Return the curves of a run; of a maneuver its KPIs, too, and how it ended."""
    part = numbers_view(run, kpis, beside) if run.maneuver else None
    return {**seen.drawn(run, panels), "part": part, "empty": not (len(run.t) or run.kpis)}


def side_view(side: Side, other: Experiment, scenario: Scenario, *, blind: bool) -> dict[str, Any]:
    """Return the part of an experiment in a question: its number, role, marks and θ."""
    return {
        "number": None if blind else side.index + 1,
        "role": None if blind else side.role,
        "marks": sorted(side.marks),
        "counts_as_unsafe": side.counts_as_unsafe,
        "theta": [] if blind else theta_view(scenario.space, side.experiment, other),
    }


def numbers_view(
    experiment: Experiment, kpis: Sequence[KPI], beside: Experiment | None = None
) -> dict[str, Any]:
    """Return how an experiment ended, and those of `kpis` that it has.

    With `beside`, values have the digits that compare the two.
    """
    rows = measured_rows([kpi for kpi in kpis if kpi.name in experiment.kpis], experiment, beside)
    return {
        "ended": ended_text(experiment),
        "interrupted": experiment.end.interrupted,
        "empty": not (len(experiment.t) or experiment.kpis),
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
    space: KnobSpace, experiment: Experiment, other: Experiment | None = None, *, exact: bool = False
) -> list[dict[str, Any]]:
    """Return θ with units, and whether each value as shown differs from that of `other`.

    With `exact` it has the digits of the exported one, as a result has.
    """
    texts = theta_texts(space, experiment.theta)
    others = texts if other is None else theta_texts(space, other.theta)
    return [
        {
            "name": k.name,
            "about": k.about,
            "unit": k.unit,
            "text": exact_number(value) if exact else text,
            "differs": text != its,
        }
        for k, value, text, its in zip(space.knobs, experiment.theta.tolist(), texts, others, strict=True)
    ]


def theta_texts(space: KnobSpace, theta: Iterable[float]) -> list[str]:
    """Return the values of θ as people read them, without units."""
    return [knob_number(k, float(v)) for k, v in zip(space.knobs, theta, strict=True)]


# --- Preview what a person confirms: a rig's record, or what a run writes to a live plant.


def preview_view(interview: Interview, record: Record) -> dict[str, Any]:
    """Return PREVIEW for the page."""
    scenario, seen = interview.scenario, interview.preview(record)
    experiment, study = seen.experiment, Seen().look(interview)
    panels, unit = panels_of(scenario, experiment), experiment.channels.time_unit
    side = Side(record.index, experiment, challenger=True)
    first, last = (quantity(float(experiment.t[k]), unit) for k in (0, -1))
    return {
        "panels": [panel_view(panel) for panel in panels],
        "axes": study.frame(panels, experiment),
        "side": {
            **numbers_view(experiment, scenario.shown_kpis),
            **side_view(side, experiment, scenario, blind=False),
            **run_view(experiment, panels, scenario.shown_kpis, study),
        },
        "time_unit": unit,
        "text": f"{len(experiment.t)} rows, from {first} to {last}",
        "same": seen.same is not None,
        "warnings": list(warnings(seen)),
    }


def warnings(seen: Preview) -> Iterator[str]:
    """Yield the reasons not to save a record."""
    if seen.same is not None:
        yield (
            f"These are exactly the curves of experiment {seen.same + 1}: is this the file of another run?"
        )
    if seen.retracts:
        yield f"{counted(seen.retracts, 'answer')} about the record that it replaces will no longer count."


def plant_view(scenario: Scenario, plant: PlantNow | None) -> dict[str, Any] | None:
    """Return what the page shows of a live plant; None if the scenario has none."""
    if plant is None:
        return None
    source = scenario.source
    return {
        "changes": None if plant.changes is None else [change_view(each) for each in plant.changes],
        "problem": plant.problem,
        "unrestored": plant.recovery is Recovery.FAILED and plant.progress is None,
        "instructions": source.instructions,
        "duration": _plain(source.duration),
        "afterward": source.afterward,
        "stops": source.stops,
        "running": _running(plant),
    }


def change_view(change: Change) -> dict[str, str]:
    """Return a value to write, in words."""
    return {
        "name": change.name,
        "unit": change.unit,
        "old": "unknown" if isnan(change.old) else f"{change.old:.6g}",
        "new": f"{change.new:.6g}",
        "limits": f"{change.quantity.low:g} to {change.quantity.high:g}",
        "rate": "any" if isinf(change.rate) else f"{change.rate:g}",
    }


def _running(plant: PlantNow) -> dict[str, Any] | None:
    """Return how far the plant's run is; None if none is in progress."""
    progress = plant.progress
    if progress is None:
        return None
    return {
        "stage": progress.stage.value,
        "recovers": plant.recovery is not Recovery.DONE,
        "restores": progress.stage in (Stage.RESTORING, Stage.LOST),
        "records": progress.stage is Stage.RECORDING,
        "elapsed": progress.elapsed,
        "problem": progress.problem,
        "stopping": plant.stopping,
        "times": list(plant.times),
        "outputs": [
            {
                "name": curve.channel.name,
                "unit": curve.channel.unit,
                "values": [_plain(value) for value in curve.values],
                "reference": [_plain(value) for value in curve.reference],
            }
            for curve in plant.curves
        ],
    }


def _plain(value: float | None) -> float | None:
    """Return a number for JSON, which has no NaN and no infinity: None for those."""
    return value if value is not None and isfinite(value) else None


# --- Write the briefing: the task, what its knobs and KPIs mean, and how long it takes.

_SECONDS = 15  # seconds for one comparison at a calm pace


def brief_view(interview: Interview) -> dict[str, Any]:
    """Return the task, what the person is asked to do, and how a tuning in use is compared."""
    return {**scenario_view(interview.scenario), "how": _how(interview), "start": _current_tuning(interview)}


def scenario_view(scenario: Scenario) -> dict[str, Any]:
    """Return the task, the knobs and the KPIs of a scenario in words."""
    return {
        "title": scenario.title,
        "text": scenario.brief,
        "knobs": [knob_view(knob) for knob in scenario.space],
        "kpis": [_kpi_view(kpi) for kpi in scenario.shown_kpis],
        "panels": [panel.title or panel.name for panel in scenario.panels],
    }


def _how(interview: Interview) -> str:
    """Return what the person is asked to do, and how long it takes."""
    planned = interview.known.planned
    minutes = max(int(planned.total * _SECONDS / 60 + 0.5), 1)  # half a minute is rounded up
    pace = f"about {counted(minutes, 'minute')} at {_SECONDS} s each"
    took = "at the pace of your experiments" if interview.scenario.source.asks else pace
    return (
        "You are shown two experiments at a time and say which one went better: "
        f"{counted(planned.total, 'question')}, {took}. Follow your own "
        "judgment: there is no right answer, and “about the same” and “can't tell” are answers too. Every "
        "answer is saved at once; you can stop and resume at any time, and finish as soon as one experiment "
        "is good enough."
    )


def _current_tuning(interview: Interview) -> str:
    """Return how to compare with the tuning in use; empty if the study starts from a given one."""
    if interview.file.state.configuration["options"].get("start"):
        return ""
    space = interview.scenario.space
    values = ", ".join(f"{typed_name(knob, space)}=…" for knob in space)
    return (
        "Is a tuning in use now? Start the command again with a new study and "
        f'--start "{values}": then the result is compared with it, and not with a first '
        "experiment that prefcal chose."
    )


def _kpi_view(kpi: KPI) -> dict[str, str]:
    """Return a KPI in words, with its objective."""
    direction = "" if kpi.goal is None else f"{kpi.goal} is better"
    wanted = limits_text(kpi) or direction
    return {"title": kpi.title, "unit": kpi.unit, "about": meaning(kpi), "wanted": wanted}
