"""One run of the command on an open study: what it works on, and where its words go."""

import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from prefcal_env.errors import StudyError
from prefcal_scenarios.cli.keeping import worth_keeping
from prefcal_scenarios.cli.opening import Opened
from prefcal_scenarios.cli.outcome import as_json, show
from prefcal_scenarios.cli.recording import record_of, references
from prefcal_scenarios.interview import Interview
from prefcal_scenarios.report.ownership import Claim
from prefcal_scenarios.report.record import Record


@dataclass(frozen=True, slots=True)
class Sitting:
    """A study being worked on.

    Args:
        interview: The agent and the study file.
        opened: How it was opened.
        claim: The folder of the report.
        messages: Where people read, standard error.
        json: Whether standard output is for a program.
    """

    interview: Interview
    opened: Opened
    claim: Claim
    messages: Console
    json: bool

    @property
    def folder(self) -> Path:
        """Of the report."""
        return self.claim.folder

    @property
    def reportable(self) -> bool:
        """Whether there is anything to report: a completed experiment of a study that is kept.

        Takes no lock: the handler of Ctrl-C asks, in the middle of anything.
        """
        file = self.opened.file
        if not file.state.closed:
            return False
        if not self.opened.options.by_a_person or self.opened.resumed:
            return True
        return worth_keeping(file, self.interview.scenario)

    def stopping(self) -> None:
        """Say what a Ctrl-C sets off, at once."""
        what = "Writing the report ..." if self.reportable else "Stopping ..."
        self.say(f"{what} (Ctrl-C again ends at once; no answer is lost)")

    def closing(self) -> None:
        """Say what a Ctrl-C does once the report is written."""
        self.say("Closing ...")

    def write(self, *, rig_works: bool = True) -> Record:
        """Write the report of the study as it stands, if there is anything to report.

        Raises:
            StudyError: it cannot be written, the disk is full say.
        """
        options, scenario = self.opened.options, self.interview.scenario
        wanted = self.reportable
        shown = references(scenario, options.seed, self.messages) if rig_works and wanted else {}
        record = record_of(self.interview, options, shown)
        if wanted:
            self._write(record)
        return record

    def _write(self, record: Record) -> None:
        # Here, not above: plots take half a second to load, and a refused option must not wait.
        from prefcal_scenarios.report.write import write_report

        scenario = self.interview.scenario
        pictures = () if scenario.pictures is None else scenario.pictures()
        try:
            self.claim.renew()
            write_report(record, self.folder, pictures)
        except OSError as error:
            raise StudyError(
                f"cannot write the report into {self.folder}: {error.strerror or error}. "
                "The study itself has lost nothing"
            ) from error

    def tell(self, record: Record) -> None:
        """Print the result."""
        options = self.opened.options
        report = self.folder / "report.html" if self.reportable else None
        if self.json:
            print(as_json(record, options, report, self.opened.name), flush=True)
        elif report is None:
            self.say("Nothing to report: no experiment was compared.")
        else:
            show(record, report, Console())
            if not options.by_a_person:  # no program gives a person's answers again
                Console().print(f"Repeat it: {options.command()}", soft_wrap=True, markup=False)
        if report is not None and record.stopped and not record.good_enough:
            self.say(
                f"This is a partial report: {len(record.trials)} of {record.n_max} experiments."
            )

    @property
    def again(self) -> str:
        """The command that resumes the study."""
        options, name = self.opened.options, self.opened.name or ""
        cost = [] if options.cost is None else ["--cost", options.cost]
        return shlex.join(["prefcal", "calibrate", options.scenario, "--study", name, *cost])

    def say(self, text: str) -> None:
        """One line for people."""
        self.messages.print(text, soft_wrap=True, highlight=False, markup=False)
