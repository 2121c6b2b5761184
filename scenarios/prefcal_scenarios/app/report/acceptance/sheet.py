"""Fill in the acceptance sheet of a study."""

from dataclasses import dataclass
from io import BytesIO
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.app.presentation.style import save, style
from prefcal_scenarios.app.presentation.wording import measured, number
from prefcal_scenarios.app.report.export import versions
from prefcal_scenarios.app.report.html import data_uri, environment
from prefcal_scenarios.app.report.record import Record
from prefcal_scenarios.app.report.tables import objective
from prefcal_scenarios.app.report.trajectories import before_and_after

FILE = "acceptance.html"
"""Name of the file."""
_MOST = 12
"""Largest number of knobs, and of KPIs, for which one page has room."""
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
    """Content of an acceptance sheet, for HTML and for PDF.

    Args:
        facts: Paragraph on the study: what it consists of, and what before and after mean.
        of: Name of the study and its dates, as text that follows "Acceptance sheet".
        knobs: Lines of the knobs.
        kpis: Lines of the KPIs.
        more_knobs: Number of knobs for which the page has no room.
        more_kpis: Number of KPIs for which the page has no room.
        ends: How the runs before and after ended.
    """

    facts: str
    of: str
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
    lines = len(content.knobs) + len(content.kpis)
    picture = curves(record, height=5.0 if lines <= _MOST else 3.4)
    template = environment().get_template("app/report/acceptance/acceptance.html.j2")
    return template.render(
        record=record, sheet=content, curves=picture and data_uri(picture, "curves.png")
    )


def sheet_of(record: Record) -> Sheet:
    """Return the content of the sheet of a study with a completed experiment."""
    assert record.best is not None
    before, after = record.trials[0], record.best
    knobs = tuple(_knobs(record, before.experiment, after.experiment))
    kpis = tuple(_kpis(record, before.experiment, after.experiment))
    dates = record.dates if record.by_a_person else ()
    when = " to ".join(dict.fromkeys(_minute(at) for at in dates))
    return Sheet(
        facts=_facts(record),
        of=f"{f' of study {record.study}' if record.study else ''}{f', {when} (UTC)' * bool(when)}",
        knobs=knobs[:_MOST], more_knobs=len(knobs[_MOST:]),
        kpis=kpis[:_MOST], more_kpis=len(kpis[_MOST:]),
        ends=(before.experiment.end.value, after.experiment.end.value),
    )  # fmt: skip


def _facts(record: Record) -> str:
    """Return how much was tried and answered, and which experiments before and after are."""
    assert record.best is not None
    before, after = record.trials[0].number, record.best.number
    who = "a person" if record.by_a_person else "a program"
    counted = f"{len(record.trials)} experiments, {record.questions} comparisons by {who}"
    partial = record.stopped and not record.good_enough
    state = "; the study is not complete" if partial else ""
    words = [
        f"{counted}, prefcal {versions()['prefcal']}{state}.",
        f"Before: {_before(record)} (experiment {before}). After: experiment {after}.",
    ]
    if before == after:
        none = "No experiment was better than the first one."
        words.append(none if record.questions else "Nothing was compared.")
    return " ".join(words)


def _before(record: Record) -> str:
    return "your tuning at the start" if record.settings.get("start") else "first experiment"


def _minute(at: str) -> str:
    """Return the time of an event up to its minute: 2026-01-31 14:05."""
    return at[:16].replace("T", " ")


def _knobs(record: Record, before: Experiment, after: Experiment) -> Any:
    for i, knob in enumerate(record.scenario.space):
        limits = f"{number(knob.low)} to {number(knob.high)}"
        old, new = number(before.theta[i]), number(after.theta[i])
        yield Line(knob.name, knob.unit, limits, old, new)


def _kpis(record: Record, before: Experiment, after: Experiment) -> Any:
    for kpi in record.kpis:
        texts = measured(kpi, before), measured(kpi, after)
        yield Line(kpi.title, kpi.unit, objective(kpi), *texts, kpi.met_by(after))


def curves(record: Record, *, height: float) -> bytes:
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
