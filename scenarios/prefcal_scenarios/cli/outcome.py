"""The result of a study, for people (a table) and for programs (JSON)."""

import json
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from prefcal_env.experiment import Experiment
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.export import jsonable
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.report.wording import labelled, measured, number
from prefcal_scenarios.scenario import KPI


def as_json(record: Record, options: Options, report: Path | None, study: str | None) -> str:
    """One JSON object on several lines; strict, so null where there is no number or report."""
    best = record.best
    theta = None if best is None else record.scenario.space.named(best.experiment.theta)
    content = {
        "best": theta,
        "cost": None if best is None else best.cost,
        "kpis": None if best is None else dict(best.experiment.kpis),
        "experiments": len(record.trials),
        "questions": record.questions,
        "verdicts": record.verdict_counts(),
        "report": None if report is None else str(report),
        "scenario": options.scenario,
        "agent": options.agent,
        "calibrator": options.calibrator,
        "seed": options.seed,
        "study": study,
        "stopped": record.stopped,
    }
    return json.dumps(jsonable(content), indent=2, ensure_ascii=False, allow_nan=False)


def show(record: Record, report: Path, console: Console) -> None:
    """Print the best θ next to the references, their KPIs, and where the report is."""
    if record.best is not None:
        console.print(_table(record, record.best.experiment))
    if record.outlook is not None:
        for line in record.outlook.lines:
            console.print(line, soft_wrap=True, markup=False, highlight=False)
    console.print(Text.assemble("Report: ", (str(report), "bold")), soft_wrap=True)


def _table(record: Record, best: Experiment) -> Table:
    scenario = record.scenario
    columns = {"best": best, **record.references}
    table = Table(title=escape(scenario.title), title_style="bold", title_justify="left")
    table.add_column("")
    for i, name in enumerate(columns):
        table.add_column(escape(name), justify="right", style="bold blue" if i == 0 else "")
    for i, knob in enumerate(scenario.space):
        cells = [number(e.theta[i]) for e in columns.values()]
        table.add_row(escape(labelled(knob.name, knob.unit)), *cells)
    table.add_section()
    if record.shows_cost:
        table.add_row("performance index", *(number(record.cost(e)) for e in columns.values()))
    for kpi in record.kpis:
        cells = [_judged(kpi, e) for e in columns.values()]  # type: ignore[misc]
        table.add_row(escape(labelled(kpi.title, kpi.unit)), *cells)
    return table


def _judged(kpi: KPI, experiment: Experiment) -> Text:
    value = experiment.kpis.get(kpi.name)
    met = None if value is None else kpi.met(value)
    mark = {None: ("  ", ""), True: (" ✓", "green"), False: (" ✗", "red")}[met]
    return Text.assemble(measured(kpi, experiment), mark)
