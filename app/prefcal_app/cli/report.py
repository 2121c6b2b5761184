"""Record what a report says of a study, and print its result as a table or as JSON."""

import json as json_
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from prefcal_app.report.export import jsonable
from prefcal_app.report.record import Record
from prefcal_app.report.tables import gain_rows, result_columns, result_rows
from prefcal_app.session import Interview
from prefcal_app.session.memory import trust_text
from prefcal_app.session.view import GOOD_ENOUGH
from prefcal_app.summary.gain import Baseline
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.study import State
from prefcal_scenarios.own.source import fingerprint
from prefcal_scenarios.presentation.wording import labeled, printable
from prefcal_scenarios.scenario import Scenario

from .choices import follows_cost
from .options import Options


def record_of(
    interview: Interview, options: Options, references: Mapping[str, Experiment], name: str | None = None
) -> Record:
    """Return the record of the study as it stands, for reports."""
    now = interview.now()
    state = now.state
    agent = state.configuration["agent"]
    winners = state.history.incumbents()  # after each closed query; the last is the best now
    waiting = sorted(index for index in state.finished if index >= state.history.answered)
    times = [recorded.at for recorded in interview.study.events()]
    return Record(
        scenario=interview.scenario,
        source=options.scenario,
        comparisons=interview.comparisons(),
        answered=interview.answered(),
        held=winners if now.incumbent is None else (*winners[:-1], now.incumbent),
        waiting={index: interview.experiment(index) for index in waiting},
        references=references,
        settings=options.settings(),
        agent_settings={f"{agent['agent']} {k}": v for k, v in agent["settings"].items()},
        n_init=options.n_init,
        n_max=interview.n_max,
        command=options.command(),
        surrogate=interview.surrogate,
        trust="" if (index := interview.index) is None else trust_text(index),
        good_enough=state.ended == GOOD_ENOUGH,
        outlook=interview.outlook,
        judged=follows_cost(options, interview.scenario),
        study=name or "",
        dates=tuple(dict.fromkeys((times[0], times[-1]))),
        baseline=Baseline.of(state),
        fingerprint=_fingerprint(options, state),
    )


def _fingerprint(options: Options, state: State) -> str:
    """Return the fingerprint of the scenario, as it was at the start if that is known."""
    now = fingerprint(options.scenario)
    then = state.configuration.get("fingerprint", now)
    return str(then) if then == now else f"{then}; its files have changed since, now {now}"


def references(scenario: Scenario, seed: int, say: Callable[[str], None]) -> dict[str, Experiment]:
    """Run the reference θ; leave out those that fail, since the study itself is complete."""
    experiments: dict[str, Experiment] = {}
    if scenario.source.asks:
        return experiments
    if scenario.source.hangs and scenario.references:
        say("The references did not run: the last run had to be ended.")
        return experiments
    for name, theta in scenario.references.items():
        try:
            experiments[name] = scenario.run(theta, seed=seed)
        except Exception as error:  # a rig can raise anything
            say(f"The reference {name!r} did not run: {error}")
    return experiments


def as_json(
    record: Record, options: Options, report: Path | None, study: str | None, simulated: int | None = 0
) -> str:
    """Return the result as strict, indented JSON, with null for missing numbers or no report."""
    best = record.best
    theta = None if best is None else record.scenario.space.named(best.experiment.theta)
    content = {
        "best": theta,
        "cost": None if best is None else best.cost,
        "kpis": None if best is None else dict(best.experiment.kpis),
        "experiments": len(record.trials),
        "questions": record.questions,
        "simulated": simulated,
        "verdicts": record.verdict_counts(),
        "report": None if report is None else str(report),
        "scenario": options.scenario,
        "agent": options.agent,
        "calibrator": options.calibrator,
        "seed": options.seed,
        "study": study,
        "stopped": record.stopped,
    }
    return json_.dumps(jsonable(content), indent=2, ensure_ascii=False, allow_nan=False)


_MARKS = {None: ("  ", ""), True: (" ✓", "green"), False: (" ✗", "red")}
"""Sign and style of a value that meets its objective, or does not."""
_STYLES = {"better": "green", "worse": "red", "": ""}
"""Style of a change."""


def show(record: Record, report: Path, console: Console) -> None:
    """Print what was gained, the best θ next to the references, and the path of the report."""
    if record.best is not None:
        if record.best.index != record.baseline.index:
            console.print(_gain(record, record.best.number))
        console.print(_result(record))
    if record.outlook is not None:
        for line in record.outlook.lines:
            console.print(line, soft_wrap=True, markup=False, highlight=False)
    console.print(Text.assemble("Report: ", (str(report), "bold")), soft_wrap=True)


def _gain(record: Record, number: int) -> Table:
    """Return what was gained, largest change first."""
    before = record.baseline.name
    table = _table(f"What was gained over the {before}", [before, f"experiment {number}", "change"])
    for row in gain_rows(record):
        change = f"{row['change']} {row['verdict']}".strip()
        table.add_row(
            _plain(labeled(row["title"], row["unit"])),
            row["before"],
            Text.assemble(row["after"], _MARKS[row["met"]]),
            Text(change, _STYLES[row["verdict"]]),
        )
    return table


def _result(record: Record) -> Table:
    """Return the result table of the report, without the experiment that was before."""
    columns = {n: e for n, e in result_columns(record).items() if n != record.baseline.name}
    table = _table(record.scenario.title, columns)
    table.columns[1].style = "bold blue"
    for row in result_rows(record, columns.values()):
        cells = [Text.assemble(value.text, _MARKS[value.met]) for value in row.values]
        table.add_row(_plain(labeled(row.name, row.unit)), *cells)
    return table


def _table(title: str, columns: Iterable[str]) -> Table:
    """Return a table with a column of names, and columns of numbers."""
    table = Table("", title=_plain(title), title_style="bold", title_justify="left")
    for name in columns:
        table.add_column(_plain(name), justify="right")
    return table


def _plain(text: str) -> str:
    """Return a name out of the user's file as text that moves no cursor and is no markup."""
    return escape(printable(text))
