"""Fill in the acceptance sheet of a study: one page, before and after, with lines to sign."""

from collections.abc import Iterator, Sequence
from functools import partial
from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from markupsafe import Markup

from prefcal_app.view.tables import cell, row, table
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.plants.jacobians import U
from prefcal_env.sources.function import function_of
from prefcal_scenarios.presentation.style import save, style
from prefcal_scenarios.presentation.wording import knob_number, number, with_unit
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.verification.verified import Verified

from .answers import LINE, MOST_VERIFIED, answers, left, section, unverified, verified_answers
from .html import data_uri, environment
from .record import StudyRecord
from .tables import foremost, gain_rows, pid_forms_of
from .trajectories import best_against

_MOST, _LEAST, _FEW = 12, 8, 3
"""Largest number of knobs, and of KPIs with limits, for which one page has room; how much of it
belongs to KPIs, and how many KPIs stay on a page that is too full."""
_LINE = (46, 20, 16)
"""Characters of a name, limits and a value that stay on a line of a table."""
_PAGE, _ROW, _MORE = 203.0, 4.1, 3.4
"""Height of a page without headings and lines to sign, of a row, and of a further line in it, in mm."""
_TALL, _INCH = 125.0, 25.4
"""Largest height of curves with what follows them, and of an inch, in mm."""
_PANELS = 3
"""Largest number of panels for which one page has room."""
_KPI = ("title", "objective", "before", "after", "unit", "met")
"""What the sheet says of a KPI."""
_NEAR = 1e-6
"""Share of its size by which a value may miss a limit and still count as being at it."""


def sheet(record: StudyRecord, verified: Verified | str | None = None) -> str:
    """Return the text of the sheet, a self-contained page that prints on one A4 or Letter page.

    Args:
        record: Record of the study.
        verified: What was verified of the result, or why that is not known; None if nothing was.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    content = sheet_of(record)
    room = min(content["room"], _TALL)
    if isinstance(verified, Verified):
        holds = verified_answers(verified)
    else:
        holds = unverified(record, verified or "")
    height = left(room, holds)
    picture = _curves(record, height=height / _INCH) if height else b""
    curves, made = picture and data_uri(picture), Markup(section(holds, room))
    template = environment().get_template("report/acceptance.html.j2")
    return template.render(record=record, sheet=content, holds=made, curves=curves)


def sheet_of(record: StudyRecord) -> dict[str, Any]:
    """Return the content of the sheet of a study with a completed experiment.

    Returns:
        `of`: name and dates of the study, which follow "Acceptance sheet"; `answers`: what is asked;
        `knobs`: table of the knobs, and of a PID in its parallel form; `kpis`: table of the KPIs,
        largest change first, of limits kept, and how the runs ended; `more_knobs`, `more_kpis`:
        numbers of those for which the page has no room; `room`: what is left of it in mm.
    """
    assert record.best is not None
    before, after = record.before, record.best
    knobs, kpis = list(_knobs(record)), [_row(*(kpi[name] for name in _KPI)) for kpi in gain_rows(record)]
    kept = limits_kept(before.experiment, after.experiment, resting(record.scenario))
    limits = list(kept)[: _MOST - _LEAST]
    limits.append(_row("run ended", "", before.experiment.end.value, after.experiment.end.value))
    asked = answers(record)
    room = left(_PAGE, asked) - _height(knobs[:_MOST]) - _height(limits)
    shown = list(kpis)
    while len(shown) > _MOST - len(limits) or (
        _height(shown) > room - LINE * MOST_VERIFIED and len(shown) > _FEW
    ):
        shown = foremost(kpis, len(shown) - 1, lambda kpi: kpi["cells"][0]["text"] != "–")
    heads = [record.baseline, f"experiment {after.number}", "unit"]
    rows, columns = [*shown, *limits], ["KPI", "required", *heads, "met"]
    when = record.origin.get("when (UTC)")
    return {
        "of": f"{f' of study {record.study}' if record.study else ''}{f', {when} (UTC)' if when else ''}",
        "knobs": table("Controller parameters", ["parameter", "range", *heads], knobs[:_MOST], kind="sheet"),
        "kpis": table("Key performance indicators", columns, rows, kind="sheet"),
        "more_knobs": len(knobs[_MOST:]),
        "more_kpis": len(kpis) - len(shown),
        "answers": asked,
        "room": room - _height(shown),
    }


def _height(rows: Sequence[dict[str, Any]]) -> float:
    """Return the height of rows of a table in mm."""
    texts = [(row["name"], row["cells"][0]["text"], row["cells"][2]["text"]) for row in rows]
    more = sum(max(len(text) // most for text, most in zip(row, _LINE, strict=True)) for row in texts)
    return _ROW * len(rows) + _MORE * more


def _row(
    name: str, limits: str, before: str, after: str, unit: str = "", met: bool | None = None
) -> dict[str, Any]:
    """Return a line of the table of KPIs."""
    verdict, kind = {True: ("yes", "yes"), False: ("NO", "no"), None: ("–", "")}[met]
    new = cell(after, kind="best")
    return row(name, [cell(limits or "–"), cell(before), new, cell(unit), cell(verdict, kind=kind)])


def _knobs(record: StudyRecord) -> Iterator[dict[str, Any]]:
    """Yield a line for each knob, then the gains of a PID in its parallel form."""
    assert record.best is not None
    before, after = record.before.experiment, record.best.experiment
    lines = [
        (
            knob.name,
            f"{number(knob.low)} to {number(knob.high)}",
            *(knob_number(knob, e.theta[i]) for e in (before, after)),
            knob.unit,
        )
        for i, knob in enumerate(record.scenario.space)
    ]
    lines += [(p.name, p.derived, old, new, p.unit) for p, new, old in pid_forms_of(record) if p.derived]
    for name, limits, old, new, unit in lines:
        yield row(name, [cell(limits), cell(old), cell(new, kind="best"), cell(unit)])


def resting(scenario: Scenario) -> U | None:
    """Return the inputs before the first move, shape (n_u,); None if a scenario does not say them."""
    run = function_of(scenario.source)
    run = run.func if isinstance(run, partial) else run
    loop = getattr(run, "__self__", run)
    return getattr(getattr(getattr(loop, "env", loop), "task", None), "u0", None)


def limits_kept(before: Experiment, after: Experiment, u0: U | None = None) -> Iterator[dict[str, Any]]:
    """Yield a line for each input and output with limits, how long it was there, and for each input's moves.

    An input saturates at a limit. An output is outside beyond one. Both are shares of the time;
    several runs of an experiment (maneuvers, variants) count together. The first move starts at the
    inputs `u0`, shape (n_u,); if they are not known, it does not count, and the line says so.
    """
    named = [(True, i, c) for i, c in enumerate(after.channels.y)]
    named = [(False, i, c) for i, c in enumerate(after.channels.u)] + named
    for output, i, channel in named:
        if limits := _limits(channel):
            old, new = (_share(e, i, channel, output=output) for e in (before, after))
            what = "outside its limits" if output else "saturated"
            yield _row(f"{channel.name} {what}", limits, old, new)
    for i, channel in enumerate(after.channels.u):
        start = [] if u0 is None else [float(u0[i])]
        said = "" if start else " after the first"
        old, new = (number(_largest_move(e, i, start)) for e in (before, after))
        yield _row(f"{channel.name}, largest step between samples{said}", "", old, new, channel.unit)


def _largest_move(experiment: Experiment, i: int, start: list[float]) -> float:
    """Return the largest change of an input from one instant to the next; NaN if it was not recorded.

    It begins with that from `start`, one number, or none to leave that out.
    """
    runs = [run for run in experiment.runs or (experiment,) if len(run.t) > 1]
    moves = [np.abs(np.diff(run.u[:, i], prepend=start)) for run in runs]
    return max((float(each.max()) for each in moves), default=np.nan)


def _limits(channel: Channel) -> str:
    """Return the limits as text; empty without any."""
    low, high = np.isfinite(channel.low), np.isfinite(channel.high)
    if low and high:
        return with_unit(f"{number(channel.low)} to {number(channel.high)}", channel.unit)
    if low or high:
        sign, limit = ("≥", channel.low) if low else ("≤", channel.high)
        return f"{sign} {with_unit(number(limit), channel.unit)}"
    return ""


def _share(experiment: Experiment, i: int, channel: Channel, *, output: bool) -> str:
    """Return the share of the time as text; a dash if the signal was not recorded."""
    there = total = 0.0
    for run in experiment.runs or (experiment,):
        values = run.output(i) if output else run.u[:, i] if len(run.t) else None
        if values is None or len(run.t) < 2:
            continue
        steps = np.diff(run.t)  # values are held until the next instant
        there += float(steps[_is_there(values[:-1], channel, output=output)].sum())
        total += float(steps.sum())
    if not total:
        return "–"
    if not there:
        return "never"
    percent = 100 * there / total
    return f"{number(round(percent, 1))} % of the time" if percent >= 0.05 else "< 0.1 % of the time"


def _is_there(values: Float[np.ndarray, " K"], channel: Channel, *, output: bool) -> Bool[np.ndarray, " K"]:
    """Return where an input is at a limit, or an output beyond one."""
    ends = [limit for limit in (channel.low, channel.high) if np.isfinite(limit)]
    near = _NEAR * max(map(abs, (*ends, 1e-300)))
    margin = near if output else -near
    outside: Bool[np.ndarray, " K"] = (values < channel.low - margin) | (values > channel.high + margin)
    return outside


def _curves(record: StudyRecord, *, height: float) -> bytes:
    """Return a PNG of the curves before and after; empty if neither run has a record.

    Args:
        record: Record of the study.
        height: Height of the picture in inches.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    content = BytesIO()
    with style():
        figure = best_against(record, references=False, panels=_PANELS, most=height)
        if figure is not None:
            save(figure, content)
    return content.getvalue()
