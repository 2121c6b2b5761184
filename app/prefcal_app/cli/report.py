"""Write the report of a study, and print its result as a table or as JSON."""

import json as json_
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from prefcal_app.cli.studies.files import existing, open_described, trusted_source
from prefcal_app.report.export import jsonable
from prefcal_app.report.ownership import Claim
from prefcal_app.report.record import Record
from prefcal_app.report.tables import gain_rows, result_columns, result_rows
from prefcal_app.session import Interview, Now
from prefcal_app.session.kpi_index import trust_text
from prefcal_app.session.memory import is_simulating
from prefcal_app.session.view import GOOD_ENOUGH
from prefcal_app.summary.gain import Baseline
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.live import LiveRig
from prefcal_env.rig import Rig
from prefcal_env.study import State
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import IsolatedRun, isolation
from prefcal_scenarios.own.source import fingerprint
from prefcal_scenarios.presentation.wording import (
    earlier_text,
    labeled,
    printable,
    printable_lines,
)
from prefcal_scenarios.scenario import Scenario

from .choices import follows_cost
from .cost_file import kept_cost, with_cost
from .opening import Opened, by_now, claim_folder, worth_keeping
from .options import Options

_KNOWN = 2.0
"""Longest wait, in seconds, for what a screening agent expects of its simulations in the end."""


@dataclass(frozen=True, slots=True)
class Reporter:
    """Writer of a study's report and result, which can be repeated while the study runs.

    Args:
        interview: Interview, which holds the agent and the study file.
        opened: Opened study.
        claim: Claim on the folder of the report.
        messages: Console for messages, standard error.
    """

    interview: Interview
    opened: Opened
    claim: Claim
    messages: Console

    @property
    def reportable(self) -> bool:
        """Return whether the study has a completed experiment and is kept, so can be reported.

        Takes no lock, since the handler of Ctrl-C calls it at any point.
        """
        file = self.opened.file
        if not file.state.history.answered:
            return False
        if not self.opened.options.by_a_person or self.opened.resumed:
            return True
        return worth_keeping(file, self.interview.scenario)

    def write(self, *, failed: bool = False) -> Record:
        """Write the report of the study as it stands, if there is anything to report.

        Args:
            failed: Whether the scenario has just failed: no references run, and nothing more is
                said about its cost.

        Raises:
            StudyError: If it cannot be written, for example because the disk is full.
        """
        options, scenario = self.opened.options, self.interview.scenario
        wanted = self.reportable
        self.interview.wait_for_screened(_KNOWN)
        shown = {} if failed or not wanted else references(scenario, options.seed, self.messages)
        record, trouble = record_of(self.interview, options, shown, self.opened.name).costed()
        if trouble and not failed:
            self.say(f"prefcal: the report has no costs: {trouble}")
        if wanted:
            self._write(record)
        return record

    def _write(self, record: Record) -> None:
        # Imported here: plotting takes half a second, and invalid options must fail fast.
        from prefcal_app.report.write import write_report

        scenario = self.interview.scenario
        pictures = () if scenario.pictures is None else scenario.pictures()
        try:
            self.claim.renew()
            write_report(record, self.claim.folder, pictures)
        except OSError as error:
            raise StudyError(
                f"cannot write the report into {self.claim.folder}: {error.strerror or error}. "
                "The study itself has lost nothing"
            ) from error

    def tell(self, record: Record) -> None:
        """Print the result."""
        options = self.opened.options
        report = self.claim.folder / "report.html" if self.reportable else None
        if options.json:
            found = as_json(record, options, report, self.opened.name, self._simulated)
            print(found, flush=True)
        elif report is None:
            self.say("Nothing to report: no experiment was compared.")
        else:
            show(record, report, Console(emoji=False))
            if not options.by_a_person:  # no program can repeat a person's answers
                # ":100:" in the range of a knob is no emoji
                Console(emoji=False).print(
                    f"Repeat it: {options.command()}", soft_wrap=True, markup=False
                )
        if report is not None and record.stopped and not record.good_enough:
            self.say(
                f"This is a partial report: {len(record.trials)} of {record.n_max} experiments."
            )

    @property
    def _simulated(self) -> int | None:
        """Return how many θ were simulated unseen; None if this is not known any more."""
        if not is_simulating(self.interview.study.state):
            return 0
        found = self.interview.simulated
        return None if found is None or not found.simulated else found.simulated

    def say(self, text: str) -> None:
        """Print one line for the user."""
        say(self.messages, text)


def say(messages: Console, text: str) -> None:
    """Print one line for the user, whatever is in it."""
    messages.print(printable_lines(text), soft_wrap=True, highlight=False, markup=False)


def report_of(
    name: str, source: str | None, cost: str | None, *, out: Path | None, json: bool
) -> None:
    """Write the report of the study called `name`.

    Args:
        name: Name of the study.
        source: Scenario program that the user trusts; None if not given.
        cost: Cost that the user gives, perhaps a program that they trust; None if not given.
        out: Folder of the report; None for the default.
        json: Whether to print the result as JSON.

    Raises:
        StudyError: If there is no such study, or its scenario must be given.
        SettingsError: If its cost is a program and must be given.
    """
    with open_described(existing(name)) as file, ExitStack() as stack:
        stored = by_now(file.state)
        cost = kept_cost(stored) if cost is None else cost
        source = trusted_source(name, file.state, source)
        isolated = stack.enter_context(isolation(source, early=False))
        scenario = isolated(with_cost(load(source), cost))
        if cost is not None and stored.get("cost") is not None:
            stored = {**stored, "cost": cost}  # the file may have moved
        # A report simulates nothing, so its twin is taken as it is.
        twin = stored.get("twin")
        given = {"scenario": source, "cost": cost, "twin": twin, "out": out, "json": json}
        opened = Opened(file, Options.resumed(stored, given), name, resumed=True)
        if not file.state.history.answered:
            raise StudyError(f"study {name!r} has no completed experiment yet: nothing to report")
        # A page may have the study open: writing an event here would make its next answer fail.
        interview = Interview(scenario, file, ahead=False, asks=False)
        claim = claim_folder(opened, scenario.name)
        try:
            reporter = Reporter(interview, opened, claim, Console(stderr=True, emoji=False))
            reporter.tell(reporter.write())
        finally:
            claim.release()


def record_of(
    interview: Interview,
    options: Options,
    references: Mapping[str, Experiment],
    name: str | None = None,
) -> Record:
    """Return the record of the study as it stands, for reports."""
    now = interview.now()
    state = now.state
    agent = state.configuration["agent"]
    taken = state.configuration.get("earlier")
    earlier = {} if taken is None else {"earlier study": earlier_text(taken)}
    return Record(
        scenario=interview.scenario,
        source=options.scenario,
        comparisons=interview.comparisons(),
        answered=interview.answered(),
        held=_best_after_each(now),
        waiting=_waiting(interview, now),
        references=references,
        settings=dict(options.settings()) | earlier,
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
        dates=_dates(interview),
        baseline=Baseline.of(state),
        fingerprint=_fingerprint(options, state),
    )


def _fingerprint(options: Options, state: State) -> str:
    """Return the fingerprint of the scenario, as it was at the start if that is known."""
    now = fingerprint(options.scenario)
    then = state.configuration.get("fingerprint", now)
    return str(then) if then == now else f"{then}; its files have changed since, now {now}"


def _dates(interview: Interview) -> tuple[str, ...]:
    """Return the times of the study's first and last event."""
    times = [recorded.at for recorded in interview.study.events()]
    return tuple(dict.fromkeys((times[0], times[-1])))


def _best_after_each(now: Now) -> tuple[int, ...]:
    """Return the best experiment's index after each closed query; the last is the best now."""
    winners = now.state.history.incumbents()
    return winners if now.incumbent is None else (*winners[:-1], now.incumbent)


def _waiting(interview: Interview, now: Now) -> dict[int, Experiment]:
    """Return the completed experiments that have not been compared yet, by index."""
    state = now.state
    indices = sorted(index for index in state.finished if index >= state.history.answered)
    return {index: interview.experiment(index) for index in indices}


def references(scenario: Scenario, seed: int, messages: Console) -> dict[str, Experiment]:
    """Run the reference θ; leave out those that fail, since the study itself is complete."""
    experiments: dict[str, Experiment] = {}
    run = scenario.run
    if isinstance(run, Rig | LiveRig):
        return experiments
    if isinstance(run, IsolatedRun) and run.worker.hangs and scenario.references:
        messages.print("The references did not run: the last run had to be ended.")
        return experiments
    for name, theta in scenario.references.items():
        try:
            experiments[name] = scenario.run(theta, seed=seed)
        except Exception as error:  # a rig can raise anything
            say(messages, f"The reference {name!r} did not run: {error}")
    return experiments


def as_json(
    record: Record,
    options: Options,
    report: Path | None,
    study: str | None,
    simulated: int | None = 0,
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


def show(record: Record, report: Path, console: Console) -> None:
    """Print what was gained, the best θ next to the references, and the path of the report."""
    if record.best is not None:
        if record.best.index != record.baseline.index:
            console.print(_gain(record))
        console.print(_table(record))
    if record.outlook is not None:
        for line in record.outlook.lines:
            console.print(line, soft_wrap=True, markup=False, highlight=False)
    console.print(Text.assemble("Report: ", (str(report), "bold")), soft_wrap=True)


def _gain(record: Record) -> Table:
    """Return what was gained, largest change first."""
    assert record.best is not None
    table = Table(title=f"What was gained over the {escape(record.baseline.name)}",
                  title_style="bold", title_justify="left")  # fmt: skip
    for heading in ("", record.baseline.name, f"experiment {record.best.number}", "change"):
        table.add_column(_plain(heading), justify="right" if heading else "left")
    styles = {"better": "green", "worse": "red", "": ""}
    for row in gain_rows(record):
        change = f"{row['change']} {row['verdict']}".strip()
        table.add_row(
            _plain(labeled(row["title"], row["unit"])), row["before"],
            Text.assemble(row["after"], _MARKS[row["met"]]), Text(change, styles[row["verdict"]]),
        )  # fmt: skip
    return table


_MARKS = {None: ("  ", ""), True: (" ✓", "green"), False: (" ✗", "red")}
"""Sign and style of a value that meets its objective, or does not."""


def _table(record: Record) -> Table:
    """Return the result table of the report, without the experiment that was before."""
    columns = {n: e for n, e in result_columns(record).items() if n != record.baseline.name}
    table = Table(title=_plain(record.scenario.title), title_style="bold", title_justify="left")
    table.add_column("")
    for i, name in enumerate(columns):
        table.add_column(_plain(name), justify="right", style="bold blue" if i == 0 else "")
    for row in result_rows(record, columns.values()):
        cells = [Text.assemble(value.text, _MARKS[value.met]) for value in row.values]
        table.add_row(_plain(labeled(row.name, row.unit)), *cells)
    return table


def _plain(text: str) -> str:
    """Return a name out of the user's file as text that moves no cursor and is no markup."""
    return escape(printable(text))
