"""Fill in the acceptance sheet of a study: one page, before and after, with lines to sign."""

from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from prefcal_app.view.end import FIRST
from prefcal_app.view.tables import cell, row, table
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_scenarios.presentation.style import save, style
from prefcal_scenarios.presentation.wording import knob_number, number, with_unit

from .export import versions
from .html import data_uri, environment
from .record import StudyRecord
from .tables import foremost, gain_rows, pid_forms_of
from .trajectories import best_against

FILE = "acceptance.html"
"""Name of the file."""
_MOST, _LEAST = 12, 8
"""Largest number of knobs, and of KPIs with limits, for which one page has room; how much of it
belongs to KPIs."""
_HIGH, _LINE = 0.2, (50, 20, 16)
"""Height that curves gain without a line of a table, in inches, and characters of a name, limits
and a value that stay on a line."""
_PANELS = 3
"""Largest number of panels for which one page has room."""
_KPI = ("title", "objective", "before", "after", "unit", "met")
"""What the sheet says of a KPI."""
_NEAR = 1e-6
"""Share of its size by which a value may miss a limit and still count as being at it."""


def sheet(record: StudyRecord) -> str:
    """Return the text of the sheet, a self-contained page that prints on one A4 or Letter page.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    content = sheet_of(record)
    rows = [
        (each["name"], each["cells"][0]["text"], each["cells"][2]["text"])
        for each in (*content["knobs"]["rows"], *content["kpis"]["rows"][:-1])
    ]
    lines = sum(1 + max(len(text) // room for text, room in zip(row, _LINE, strict=True)) for row in rows)
    picture = _curves(record, height=min(5.0, max(2.0, 2.4 + _HIGH * (2 * _MOST - lines))))
    template = environment().get_template("report/acceptance.html.j2")
    return template.render(record=record, sheet=content, curves=picture and data_uri(picture))


def sheet_of(record: StudyRecord) -> dict[str, Any]:
    """Return the content of the sheet of a study with a completed experiment.

    Returns:
        `facts`: paragraphs on the study; `of`: its name and dates, which follow "Acceptance sheet";
        `knobs`: table of the knobs, and of a PID in its parallel form; `kpis`: table of the KPIs,
        largest change first, of limits kept, and how the runs ended; `more_knobs`, `more_kpis`:
        numbers of those for which the page has no room.
    """
    assert record.best is not None
    before, after = record.before, record.best
    knobs, kpis = list(_knobs(record)), [_row(*(kpi[name] for name in _KPI)) for kpi in gain_rows(record)]
    limits = list(limits_kept(before.experiment, after.experiment))[: _MOST - _LEAST]
    room = _MOST - len(limits)
    shown = foremost(kpis, room, lambda kpi: kpi["cells"][0]["text"] != "–")
    ends = _row("run ended", "", before.experiment.end.value, after.experiment.end.value)
    heads = [record.baseline, f"experiment {after.number}", "unit"]
    rows, columns = [*shown, *limits, ends], ["KPI", "required", *heads, "met"]
    when = record.origin.get("when (UTC)")
    return {
        "facts": list(_facts(record)),
        "of": f"{f' of study {record.study}' if record.study else ''}{f', {when} (UTC)' if when else ''}",
        "knobs": table("Controller parameters", ["parameter", "range", *heads], knobs[:_MOST], kind="sheet"),
        "kpis": table("Key performance indicators", columns, rows, kind="sheet"),
        "more_knobs": len(knobs[_MOST:]),
        "more_kpis": max(len(kpis) - room, 0),
    }


def _row(
    name: str, limits: str, before: str, after: str, unit: str = "", met: bool | None = None
) -> dict[str, Any]:
    """Return a line of the table of KPIs."""
    verdict, kind = {True: ("yes", "yes"), False: ("NO", "no"), None: ("–", "")}[met]
    new = cell(after, kind="best")
    return row(name, [cell(limits or "–"), cell(before), new, cell(unit), cell(verdict, kind=kind)])


def _facts(record: StudyRecord) -> Iterator[str]:
    """Yield how much was tried, who answered, and how to get back, a paragraph each."""
    assert record.best is not None
    before, after = record.before.number, record.best.number
    by = record.origin.get("answered by", "a score")
    counted = f"{len(record.trials)} experiments, {record.questions} comparisons by {by}"
    partial = record.stopped and not record.good_enough
    state = "; the study is not complete" if partial else ""
    digits = record.origin.get("fingerprint of the scenario")
    made = f", fingerprint of the scenario {digits}" if digits else ""
    yield f"{counted}, prefcal {versions()['prefcal']}{made}{state}."
    name = record.baseline
    words = f"Before: {name} (experiment {before}). After: experiment {after}."
    if before == after:
        none = f"No experiment was better than the {name}."
        words += f" {none if record.questions else 'Nothing was compared.'}"
    if name == FIRST:
        yield f"{words} It was chosen by prefcal: the tuning in use was not given (--start)."
    else:
        yield f"{words} To go back, set the parameters of the column “{name}”."


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


def limits_kept(before: Experiment, after: Experiment) -> Iterator[dict[str, Any]]:
    """Yield a line for each input and output with limits: how long it was at or beyond one.

    An input saturates at a limit. An output is outside beyond one. Both are shares of the time;
    several runs of an experiment (maneuvers, variants) count together.
    """
    named = [(True, i, c) for i, c in enumerate(after.channels.y)]
    named = [(False, i, c) for i, c in enumerate(after.channels.u)] + named
    for output, i, channel in named:
        if limits := _limits(channel):
            old, new = (_share(e, i, channel, output=output) for e in (before, after))
            what = "outside its limits" if output else "saturated"
            yield _row(f"{channel.name} {what}", limits, old, new)


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
