"""Show the briefing in a terminal: the task, the knobs and KPIs, and the duration."""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from prefcal_app.session import Interview
from prefcal_app.view.brief import current_tuning, how, knob_view, kpi_view
from prefcal_scenarios.presentation.wording import labeled, printable, printable_lines
from prefcal_scenarios.scenario import Scenario


def show_brief(interview: Interview, console: Console) -> None:
    """Print everything that a person should know before the first question."""
    show_scenario(interview.scenario, console)
    console.print(Text(how(interview)))
    if start := current_tuning(interview):
        console.print(Text(start))


def show_scenario(scenario: Scenario, console: Console) -> None:
    """Print a scenario's task, knobs and KPIs."""
    console.rule(Text(printable(scenario.title), style="bold"))
    if scenario.brief:
        console.print(Text(printable_lines(scenario.brief)))
    knobs = [knob_view(knob) for knob in scenario.space]
    _table(
        "Knobs", [(labeled(k["name"], k["unit"]), k["about"], k["range"]) for k in knobs], console
    )
    kpis = [kpi_view(kpi) for kpi in scenario.shown_kpis]
    _table(
        "KPIs", [(labeled(k["title"], k["unit"]), k["about"], k["wanted"]) for k in kpis], console
    )


def _table(title: str, rows: list[tuple[str, str, str]], console: Console) -> None:
    if not rows:
        return
    table = Table(
        title=title, title_justify="left", title_style="bold", box=None, show_header=False
    )
    for name, about, wanted in (map(printable, row) for row in rows):
        table.add_row(Text(name, style="bold"), Text(about), Text(wanted, style="dim"))
    console.print(table)
