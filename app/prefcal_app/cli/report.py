"""Record what a report says of a study, and print its result as a table or as JSON."""

import json as json_
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from prefcal_app.report.export import jsonable
from prefcal_app.report.record import StudyRecord
from prefcal_app.report.tables import gain_of, result_table
from prefcal_app.session import Interview
from prefcal_app.session.study.memory import trust_text
from prefcal_app.terminal.showing import say
from prefcal_app.view.end import baseline_of
from prefcal_env.disk import digest_of
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.study import State
from prefcal_scenarios.own.source import fingerprint
from prefcal_scenarios.presentation.wording import labeled, printable
from prefcal_scenarios.scenario import Scenario

from .choices import follows_cost
from .options import Options


def record_of(
    interview: Interview, options: Options, references: Mapping[str, Experiment], name: str | None = None
) -> StudyRecord:
    """Return the record of the study as it stands, for reports."""
    now = interview.now()
    state = now.state
    agent = state.configuration["agent"]
    winners = state.history.incumbents()  # after each closed query; the last is the best now
    waiting = sorted(index for index in state.finished if index >= state.history.answered)
    kept = Path(interview.file.path)
    times = [recorded.at for recorded in interview.file.events()]
    return StudyRecord(
        scenario=interview.scenario,
        source=options.scenario,
        comparisons=interview.past.comparisons(),
        answered=interview.past.answered(),
        held=winners if now.incumbent is None else (*winners[:-1], now.incumbent),
        waiting={index: interview.past.experiment(index) for index in waiting},
        references=references,
        settings=options.settings(),
        agent_settings={f"{agent['agent']} {k}": v for k, v in agent["settings"].items()},
        n_init=options.n_init,
        n_max=interview.known.n_max,
        command=options.command(),
        surrogate=interview.known.surrogate,
        trust="" if (index := interview.known.index) is None else trust_text(index),
        ended=state.ended or "",
        outlook=interview.known.outlook,
        judged=follows_cost(options, interview.scenario),
        study=name or "",
        dates=tuple(dict.fromkeys((times[0], times[-1]))),
        baseline=baseline_of(state),
        fingerprint=_fingerprint(options, state),
        digest=digest_of(kept) if options.by_a_person and kept.is_file() else "",
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
    record: StudyRecord, options: Options, report: Path | None, study: str | None, simulated: int | None = 0
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


_SIGNS = {None: ("  ", ""), True: (" ✓", "green"), False: (" ✗", "red")}
"""Sign and style of a value that meets its objective, or does not."""
_STYLES = {"yes": "green", "no": "red"}
"""Style of a cell by its last class."""


def show(record: StudyRecord, report: Path, console: Console) -> None:
    """Print what was gained, the best θ next to the references, and the path of the report."""
    if record.best is not None:
        gain, result = gain_of(record), result_table(record)
        if not gain["same"]:
            console.print(_drawn(gain["title"], gain["table"]))
        shown = _drawn(record.scenario.title, result)
        shown.columns[1].style = "bold blue"
        console.print(shown)
        if gain["before"]:
            say(console, gain["back"])
    if record.outlook is not None:
        for line in record.outlook.lines:
            console.print(line, soft_wrap=True, markup=False, highlight=False)
    console.print(Text.assemble("Report: ", (str(report), "bold")), soft_wrap=True)


def _drawn(title: str, table: Mapping[str, Any]) -> Table:
    """Return a table of the view for the console: a column of names, and columns of values."""
    drawn = Table("", title=plain(title), title_style="bold", title_justify="left")
    for column in table["columns"][1:]:
        drawn.add_column(plain(column["name"]), justify="right")
    signed = {k for row in table["rows"] for k, cell in enumerate(row["cells"]) if cell["met"] is not None}
    for row in table["rows"]:
        cells = [
            Text.assemble(
                (cell["text"], _STYLES.get(cell["kind"].rpartition(" ")[2], "")),
                _SIGNS[cell["met"]] if k in signed else "",
            )
            for k, cell in enumerate(row["cells"])
        ]
        drawn.add_row(plain(labeled(row["name"], row["unit"])), *cells)
    return drawn


def plain(text: str) -> str:
    """Return a name out of the user's file as text that moves no cursor and is no markup."""
    return escape(printable(text))
