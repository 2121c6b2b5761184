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


def sheet(record: Record) -> str:
    """Return the text of the sheet, a self-contained page that prints on one A4 or Letter page.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    assert record.best is not None
    before, after = record.trials[0], record.best
    knobs = list(_knobs(record, before.experiment, after.experiment))
    kpis = list(_kpis(record, before.experiment, after.experiment))
    dates = record.dates if record.by_a_person else ()
    view: dict[str, Any] = {
        "before": f"{_before(record)} (experiment {before.number})",
        "after": f"experiment {after.number}",
        "same": before.number == after.number,
        "knobs": knobs[:_MOST], "more_knobs": len(knobs[_MOST:]),
        "kpis": kpis[:_MOST], "more_kpis": len(kpis[_MOST:]),
        "ends": (before.experiment.end.value, after.experiment.end.value),
        "dates": " to ".join(dict.fromkeys(_minute(at) for at in dates)),
        "version": versions()["prefcal"],
        "curves": _curves(record, len(knobs[:_MOST]) + len(kpis[:_MOST])),
    }  # fmt: skip
    template = environment().get_template("app/report/acceptance/acceptance.html.j2")
    return template.render(record=record, **view)


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


def _curves(record: Record, lines: int) -> str:
    """Return the curves before and after as a data URI, as high as the tables leave room for."""
    with style():
        figure = before_and_after(record, panels=_PANELS, height=5.0 if lines <= 12 else 3.4)
        if figure is None:
            return ""
        content = BytesIO()
        save(figure, content)
    return data_uri(content.getvalue(), "curves.png")
