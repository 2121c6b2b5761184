"""Fill in the acceptance sheet of a study."""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

from prefcal_app.report.export import versions
from prefcal_app.report.html import data_uri, environment
from prefcal_app.report.record import Record
from prefcal_app.report.tables import foremost, gain_rows, pid_rows
from prefcal_app.report.trajectories import before_and_after
from prefcal_app.summary.gain import FIRST
from prefcal_scenarios.presentation.style import save, style
from prefcal_scenarios.presentation.wording import knob_number, number

from .limits import limits_kept

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


@dataclass(frozen=True, slots=True)
class Line:
    """Line of a table of the sheet: a knob or a KPI before and after, as text.

    Args:
        name: Name or title.
        unit: Unit of the values.
        limits: Range of a knob, or objective of a KPI; empty for none.
        before: Value before.
        after: Value after.
        met: Whether the value after meets the objective; None if there is none.
    """

    name: str
    unit: str
    limits: str
    before: str
    after: str
    met: bool | None = None


@dataclass(frozen=True, slots=True)
class Sheet:
    """Content of an acceptance sheet.

    Args:
        facts: Paragraphs on the study: what it consists of, who answered and when, what before and
            after mean, and the way back.
        of: Name of the study and its dates, as text that follows "Acceptance sheet".
        columns: Headings of the values before and after.
        knobs: Lines of the knobs, and of a PID in its parallel form.
        kpis: Lines of the KPIs, largest change first, and of limits kept.
        more_knobs: Number of knobs for which the page has no room.
        more_kpis: Number of KPIs for which the page has no room.
        ends: How the runs before and after ended.
    """

    facts: tuple[str, ...]
    of: str
    columns: tuple[str, str]
    knobs: tuple[Line, ...]
    kpis: tuple[Line, ...]
    more_knobs: int
    more_kpis: int
    ends: tuple[str, str]


def sheet(record: Record) -> str:
    """Return the text of the sheet, a self-contained page that prints on one A4 or Letter page.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    content = sheet_of(record)
    rows = [(k.name, k.limits, k.after) for k in (*content.knobs, *content.kpis)]
    lines = sum(
        1 + max(len(text) // room for text, room in zip(row, _LINE, strict=True)) for row in rows
    )
    picture = _curves(record, height=min(5.0, max(2.0, 2.4 + _HIGH * (2 * _MOST - lines))))
    template = environment().get_template("report/acceptance/acceptance.html.j2")
    return template.render(record=record, sheet=content, curves=picture and data_uri(picture))


def sheet_of(record: Record) -> Sheet:
    """Return the content of the sheet of a study with a completed experiment."""
    assert record.best is not None
    before, after = record.before, record.best
    knobs, kpis = tuple(_knobs(record)), _kpis(record)
    kept = limits_kept(before.experiment, after.experiment)
    limits = tuple(Line(name, "", span, old, new) for name, span, old, new in kept)
    limits = limits[: _MOST - _LEAST]
    room = _MOST - len(limits)
    when = record.origin.get("when (UTC)")
    return Sheet(
        facts=tuple(_facts(record)),
        of=f"{f' of study {record.study}' if record.study else ''}{f', {when} (UTC)' * bool(when)}",
        columns=(record.baseline.name, f"experiment {after.number}"),
        knobs=knobs[:_MOST], more_knobs=len(knobs[_MOST:]),
        kpis=(*foremost(kpis, room, lambda line: bool(line.limits)), *limits),
        more_kpis=max(len(kpis) - room, 0),
        ends=(before.experiment.end.value, after.experiment.end.value),
    )  # fmt: skip


def _facts(record: Record) -> Iterator[str]:
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
    name = record.baseline.name
    words = f"Before: {name} (experiment {before}). After: experiment {after}."
    if before == after:
        none = f"No experiment was better than the {name}."
        words += f" {none if record.questions else 'Nothing was compared.'}"
    if name == FIRST:
        yield f"{words} It was chosen by prefcal: the tuning in use was not given (--start)."
    else:
        yield f"{words} To go back, set the parameters of the column “{name}”."


def _knobs(record: Record) -> Iterator[Line]:
    """Yield a line for each knob, then the gains of a PID in its parallel form."""
    assert record.best is not None
    before, after = record.before.experiment, record.best.experiment
    for i, knob in enumerate(record.scenario.space):
        limits = f"{number(knob.low)} to {number(knob.high)}"
        old, new = (knob_number(knob, e.theta[i]) for e in (before, after))
        yield Line(knob.name, knob.unit, limits, old, new)
    for row in pid_rows(record):
        if row.derived:
            yield Line(row.name, row.unit, row.derived, row.before, row.best)


def _kpis(record: Record) -> list[Line]:
    return [
        Line(row["title"], row["unit"], row["objective"], row["before"], row["after"], row["met"])
        for row in gain_rows(record)
    ]


def _curves(record: Record, *, height: float) -> bytes:
    """Return a PNG of the curves before and after; empty if neither run has a record.

    Args:
        record: Record of the study.
        height: Height of the picture in inches.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    content = BytesIO()
    with style():
        figure = before_and_after(record, panels=_PANELS, height=height)
        if figure is not None:
            save(figure, content)
    return content.getvalue()
