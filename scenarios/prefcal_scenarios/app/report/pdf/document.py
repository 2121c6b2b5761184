"""Put the report of a study on A4 pages: the acceptance sheet, figures, and every answer."""

from collections.abc import Sequence

from prefcal_scenarios.app.presentation.style import WIDTH
from prefcal_scenarios.app.presentation.wording import knob_number, labeled, number, objective
from prefcal_scenarios.app.report.acceptance import curves, sheet_of
from prefcal_scenarios.app.report.export import rebuild, versions
from prefcal_scenarios.app.report.html import lead, listed
from prefcal_scenarios.app.report.pictures import Drawn
from prefcal_scenarios.app.report.record import Record
from prefcal_scenarios.app.report.tables import (
    comparison_rows,
    pid_rows,
    result_columns,
    result_rows,
    shown_values,
)

from .paper import SMALL, SPACE, TITLE, Paper, size_of

FILE = "report.pdf"
"""Name of the file."""
_SIGNATURES = ("Tuned by (name, signature)", "Accepted by (name, signature)", "Date")
_SIGNED = 0.9
"""Height that the signatures need, in inches."""
_MET = {None: "", True: " (met)", False: " (NOT met)"}


def document(record: Record, drawn: Sequence[Drawn]) -> bytes:
    """Return the bytes of report.pdf, on A4 pages; equal studies give equal bytes.

    The first page is the acceptance sheet.

    Args:
        record: Record of a study with a completed experiment.
        drawn: Figures of the report.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    name = f" · {record.study}" if record.study else ""
    paper = Paper(f"{record.scenario.title}{name}")
    _acceptance(paper, record)
    paper.page()
    _results(paper, record)
    for each in drawn:
        paper.heading(each.picture.title, needed=size_of(each.content)[1] + 0.4)
        paper.image(each.content)
        paper.text(each.caption, SMALL)
    _experiments(paper, record)
    _comparisons(paper, record)
    _outlook(paper, record)
    _origin(paper, record)
    return paper.content()


def _acceptance(paper: Paper, record: Record) -> None:
    content = sheet_of(record)
    paper.text(record.scenario.title, TITLE)
    paper.text(f"Acceptance sheet{content.of}")
    for words in content.facts:
        paper.text(words, SMALL)
    paper.heading("Controller parameters")
    knobs = [(k.name, k.limits, k.before, k.after, k.unit) for k in content.knobs]
    paper.table(("parameter", "range", *content.columns, "unit"), knobs)
    if content.more_knobs:
        paper.text(f"and {content.more_knobs} more: see best.json", SMALL)
    paper.heading("Key performance indicators")
    met = {None: "–", True: "yes", False: "NO"}
    kpis = [(k.name, k.limits or "–", k.before, k.after, k.unit, met[k.met]) for k in content.kpis]
    kpis.append(("run ended", "–", *content.ends, "", "–"))
    paper.table(("KPI", "required", *content.columns, "unit", "met"), kpis)
    if content.more_kpis:
        paper.text(f"and {content.more_kpis} more: see report.html", SMALL)
    room = paper.left - _SIGNED - 0.5
    picture = curves(record, height=min(5.0, max(2.4, room * WIDTH / SPACE)))
    if picture and room > 1.5:
        paper.heading("Curves before and after")
        paper.image(picture, most=room)
    paper.sign(_SIGNATURES)


def _results(paper: Paper, record: Record) -> None:
    paper.text("Report", TITLE)
    paper.text(f"{lead(record)}.")
    paper.heading("Result")
    columns = result_columns(record)
    headings = ("", *columns, "required", "unit")
    rows = [
        (row.name, *(f"{v.text}{_MET[v.met]}" for v in row.values), row.aim or "–", row.unit)
        for row in result_rows(record, columns.values())
    ]
    paper.table(headings, rows)
    if pid := pid_rows(record):
        paper.heading("The PID for your control system")
        paper.table(
            ("", "form", "best", record.baseline.name, "unit"),
            [(row.name, row.form, row.best, row.before, row.unit) for row in pid],
        )
    if record.trust:
        paper.text(record.trust, SMALL)


def _experiments(paper: Paper, record: Record) -> None:
    assert record.best is not None
    paper.heading("Every experiment", needed=1.0)
    kpis = shown_values(record)
    names = [labeled(k.name, k.unit) for k in record.scenario.space]
    titles = [labeled(k.title, k.unit) + _required(objective(k)) for k in kpis]
    rows = [
        (f"{t.number}{' (best)' if t.index == record.best.index else ''}",
         *map(knob_number, record.scenario.space, t.experiment.theta), t.experiment.end.value)
        for t in record.trials
    ]  # fmt: skip
    paper.table(("experiment", *names, "ended"), rows, SMALL)
    if kpis:
        values = [
            (str(t.number), *(number(t.experiment.kpis.get(k.name)) for k in kpis))
            for t in record.trials
        ]
        paper.table(("experiment", *titles), values, SMALL)


def _required(aim: str) -> str:
    return f", {aim}" if aim else ""


def _comparisons(paper: Paper, record: Record) -> None:
    if not record.asked or record.scored:
        return
    paper.heading("Every comparison", needed=1.0)
    rows = []
    for row in comparison_rows(record):
        newer, older = row.sides
        rows.append((str(row.number), str(newer.number), str(older.number), row.verdict,
                     ", ".join(row.marks) or "–"))  # fmt: skip
    paper.table(("comparison", "newer experiment", "older experiment", "answer", "marks"), rows,
                SMALL)  # fmt: skip


def _outlook(paper: Paper, record: Record) -> None:
    if record.outlook is None:
        return
    paper.heading("Continue or stop?", needed=0.5)
    for line in record.outlook.lines:
        paper.text(line)


def _origin(paper: Paper, record: Record) -> None:
    paper.heading("How it was made" if record.by_a_person else "How to repeat it", needed=0.5)
    if record.command:
        paper.text(record.command)
    if code := rebuild(record):
        paper.text(f"The tuned controller in Python, from the folder of the report:\n{code}")
    settings = [
        (str(k), listed(v))
        for k, v in (*record.origin.items(), *record.settings.items(), *versions().items())
    ]
    paper.table(("setting or version", "value"), settings, SMALL)
